"""The metrics of a turn that are read off its tables as they are."""

import numpy as np

from pipeline.model.metrics.turn.turn_metric import BALANCE, SPEED, TURN, TurnMetric, peak_to_peak

TURN_METRICS = (
    # Transmission error under a torque that is held.
    TurnMetric(
        name="transmission_error_arcsec",
        title="Transmission error under load",
        unit="arcsec",
        definition="Angle of the output less that of the nominal ratio while {rigidity_high:g} N m are held in one "
        "sense: peak to peak over the turn, the larger of both senses.",
        rank=0,
        decimals=2,
        value=lambda turn: peak_to_peak(turn.loaded_angle),
        needs=(TURN,),
        angles=("high_plus", "high_minus"),
    ),
    # Transmission error without load.
    TurnMetric(
        name="unloaded_transmission_error_arcsec",
        title="Transmission error without load",
        unit="arcsec",
        definition="Angle of the output less that of the nominal ratio at the end of its play in one sense: peak to "
        "peak over the turn, the larger of both senses. Between the loaded angles the end is that of rigid bodies.",
        rank=1,
        decimals=2,
        value=lambda turn: peak_to_peak(turn.free_angle),
        of_play=True,
        needs=(TURN,),
        angles=("limit_plus", "limit_minus"),
    ),
    # Peak force on a disk's bearing.
    TurnMetric(
        name="bearing_force_peak_N",
        title="Peak force on a disk's bearing",
        unit="N",
        definition="Largest radial force of a disk on its input bearing, with a carrier on one of its cranks' "
        "bearings, over the loaded crank angles, {rigidity_high:g} N m held in either sense.",
        rank=2,
        decimals=0,
        needs=(TURN, BALANCE),
        value=lambda turn: np.max(np.abs(turn.bearing_force), axis=(1, 2, 3)),
    ),
    # Mean force on a disk's bearing.
    TurnMetric(
        name="bearing_force_mean_N",
        title="Mean force on a disk's bearing",
        unit="N",
        definition="Mean radial force of a disk on its input bearing, with a carrier on one of its cranks' bearings, "
        "over the loaded crank angles, {rigidity_high:g} N m held; of the sense and bearing in which it is largest.",
        rank=3,
        decimals=0,
        needs=(TURN, BALANCE),
        value=lambda turn: np.max(np.mean(np.abs(turn.bearing_force), axis=2), axis=(1, 2)),
    ),
    # Shear stress below the contacts.
    TurnMetric(
        name="subsurface_shear_MPa",
        title="Shear stress below the surface",
        unit="MPa",
        definition="Largest shear stress below any contact over the loaded crank angles under {rigidity_high:g} N m: "
        "0.300 of Hertz' peak pressure (smooth elastic line contact without friction).",
        rank=4,
        decimals=0,
        value=lambda turn: np.max(turn.shear, axis=1),
    ),
    # Depth of the largest shear stress below the contacts.
    TurnMetric(
        name="shear_depth_um",
        title="Depth of the largest shear",
        unit="µm",
        definition="Depth at which the shear stress below a contact is largest, 0.786 of Hertz' half width: of the "
        "contact in which it lies deepest over the loaded crank angles under {rigidity_high:g} N m.",
        rank=5,
        decimals=0,
        value=lambda turn: np.max(turn.shear_depth, axis=1),
    ),
    # Pressure times sliding speed.
    TurnMetric(
        name="pressure_speed_MPa_m_per_s",
        title="Pressure times sliding speed",
        unit="MPa m/s",
        definition="Largest product of pressure and sliding speed at any contact over the loaded crank angles under "
        "{rigidity_high:g} N m, at the stated speed of the input: Hertz' peak pressure where a pin slides on the "
        "disk, the mean pressure on its projected area where it rolls there and slides in its seat.",
        rank=6,
        decimals=1,
        value=lambda turn: np.max(turn.pressure_speed, axis=1),
        needs=(SPEED,),
    ),
)

"""Growth of the housing against the disk with temperature."""

from collections.abc import Sequence

from pipeline.model.effects.effect import TEMPERATURE, Conditions, Effect, Parameter
from pipeline.model.load_history.drive import Drive


def _apply(drive: Drive, values: Sequence[float], conditions: Conditions) -> Drive:
    growth = 1e-6 * values[0] * drive.profile.pin_circle_radius
    return drive.with_added_errors(pin_radial=growth * conditions.temperature_rise[:, None])


EFFECT = Effect(
    name="thermal_growth",
    title="growth of the housing against the disk with temperature",
    physics="the pin circle grows with the difference of the coefficients of expansion of housing and disk",
    source="linear thermal expansion",
    parameters=(Parameter("difference_um_per_m_K", "um/(m K)", "expansion of the housing less that of the disk"),),
    changes="radial position of all pins, with the temperature of each cycle",
    signature="play follows the temperature",
    confused_with=("run_in",),
    told_apart_by="the same loop at two temperatures",
    bounds=lambda drive: ((-200.0, 200.0),),
    apply=_apply,
    needs=frozenset({TEMPERATURE}),
)

"""The contract of the tables: keys and columns of each, and where it lies."""

CONTRACT = {
    "sample/reducer": ("sample", "eccentricity_um disk_profile_um bearing_clearance_um"),
    "sample/pins": ("sample pin", "radial_um tangential_um radius_um"),
    "sample/lobes": ("sample disk lobe", "profile_um"),
    "sample/rollers": ("sample interface roller", "diameter_um"),
    "clearance/contacts": (
        "contact crank_deg",
        "kind body_a body_b disk interface face end station label x_mm y_mm arm_mm normal_x normal_y curvature_per_mm",
    ),
    "clearance/gaps": ("sample crank_deg contact", "clearance_um"),
    "clearance/kinematic": ("sample crank_deg", "backlash_arcmin overlap_um preloaded"),
    "springs/laws": ("contact crank_deg law force_N", "local_um stiffness_N_per_um beyond_limit"),
    "reduce/contacts": ("row crank_deg", "contact patch_half_width_mm"),
    "hysteresis/curves": (
        "sample crank_deg step",
        "branch torque_Nm angle_arcmin bearing_x_um bearing_y_um pins_in_contact outputs_in_contact "
        "iterations residual",
    ),
    "hysteresis/contacts": (
        "sample crank_deg step contact",
        "torque_Nm clearance_um penetration_um elastic_um local_um force_N pressure_MPa",
    ),
    "hysteresis/status": ("sample crank_deg", "status"),
    "aggregate/metrics": (
        "sample crank_deg",
        "clearance_backlash_arcmin zero_torque_width_arcmin lost_motion_arcmin torsional_rigidity_Nm_per_arcmin "
        "hysteresis_loss_arcmin preloaded peak_pressure_MPa status",
    ),
    "hysteresis/loops": (
        "sample crank_deg",
        "limit_minus_arcmin limit_plus_arcmin zero_falling_arcmin zero_rising_arcmin peak_pressure_MPa bearing_force_N",
    ),
    "aggregate/units": ("sample", "lost_motion_arcmin_worst lost_motion_arcmin_mean lost_motion_arcmin_best status"),
    "aggregate/convergence": ("metric n_angles", "worst_mean yield extrapolated worst_mean_settled yield_settled"),
    "aggregate/sample_convergence": ("metric statistic n", "value ci_low ci_high"),
    "aggregate/distributions": ("metric over crank_deg statistic", "value ci_low ci_high n n_angles"),
    "aggregate/sensitivity": ("metric over parameter kind", "index ci_low ci_high n"),
}
"""Key and further columns of each table, from the design of the outputs; more columns may be added."""


def path_of(runs, table):
    return runs / "quick" / f"{table}.parquet"

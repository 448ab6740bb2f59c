"""Figures show the numbers they are given: positions of lines, bars and marks against the frames."""

from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex

from pipeline import assembly
from pipeline.config import load_design
from pipeline.figures.contacts import (
    dead_zones_figure,
    output_loads_figure,
    pin_clearances_figure,
    pin_loads_figure,
    spring_laws_figure,
)
from pipeline.figures.distributions import crank_figure, distributions_figure
from pipeline.figures.hysteresis import bearing_figure, hysteresis_figure
from pipeline.figures.labels import METRICS, centred_loops, parameter_title, spread_frame
from pipeline.figures.mesh import mesh_figure
from pipeline.figures.reducer import reducer_figure
from pipeline.figures.style import ALARM, save
from pipeline.figures.yields import sensitivity_figure
from pipeline.model.load_history.loop_readings import curve_readings
from pipeline.model.metrics import Definitions, library, signed_number
from pipeline.report.sections.study import flank_outline
from stages.clearance import contact_columns

ROOT = Path(__file__).parents[2]
DESIGN = load_design("pham2017", ROOT)
PINS = DESIGN.cycloid.pins
MARKS = Definitions(0.36, 6.0, 12.0)


@pytest.fixture(scope="module")
def contacts() -> pd.DataFrame:
    return pd.DataFrame(contact_columns(assembly.reducer(DESIGN, 0.0), 0.0))


def loads(contacts: pd.DataFrame, loaded_pins: list[int]) -> pd.DataFrame:
    """Contacts of one step: those in `loaded_pins` carry their own number in newtons."""
    number = contacts["contact"].to_numpy()
    closing_values = np.isin(number, loaded_pins)
    return pd.DataFrame(
        {
            "contact": number,
            "clearance_um": np.full(len(number), 2.0),
            "approach_um": np.where(closing_values, 2.5, 1.0),
            "penetration_um": np.where(closing_values, 0.5, -1.0),
            "force_N": np.where(closing_values, number, 0.0),
        }
    )


def loop(play: float, shift: float) -> pd.DataFrame:
    """Loop of half width `play` about `shift` [arcmin], stiffening with torque."""
    loading_branch = np.array([0.0, 0.36, 3.0, 6.0, 12.0])
    ladder = play + 0.3 * np.sqrt(loading_branch)
    torque = [loading_branch, loading_branch[-2::-1], -loading_branch, -loading_branch[-2::-1], loading_branch]
    angle = [ladder, ladder[-2::-1], -ladder, -ladder[-2::-1], ladder]
    names = ("loading+", "unloading+", "loading-", "unloading-", "reloading+")
    return pd.DataFrame(
        {
            "branch": np.repeat(names, [len(part) for part in torque]),
            "torque_Nm": np.concatenate(torque),
            "angle_arcmin": np.concatenate(angle) + shift,
            "bearing_x_um": np.concatenate(torque) * 0.1,
            "bearing_y_um": np.concatenate(torque) * -0.2,
        }
    )


def line(axes, label: str):
    return next(artist for artist in axes.lines if artist.get_label() == label)


def test_spread_is_of_the_samples_and_not_of_the_columns():
    values = np.arange(101.0)[:, None] * np.array([1.0, 10.0])
    spread = spread_frame(values, contact=np.array([7, 8]))
    assert spread["middle"].tolist() == [50.0, 500.0]
    assert spread["contact"].tolist() == [7, 8]
    np.testing.assert_allclose(spread["low"] + spread["high"], [100.0, 1000.0])
    assert spread["low"].iloc[0] == pytest.approx(5.0, abs=1.0)


def test_clearances_of_traces_and_band():
    rows = pd.DataFrame({"contact": np.arange(5), "clearance_um": [3.0, 2.0, -1.0, 2.0, 3.0]})
    spread = pd.DataFrame({"contact": np.arange(5), "low": -2.0, "middle": 1.0, "high": 4.0})
    axes = pin_clearances_figure({"a": rows}, spread).axes[0]
    assert line(axes, "a").get_ydata().tolist() == rows["clearance_um"].tolist()
    band = axes.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == (-2.0, 4.0)
    assert line(axes, "median of samples").get_ydata().tolist() == [1.0] * 5


def test_centring_takes_off_any_shift_and_keeps_the_width():
    rows = loop(1.0, 0.0)
    branch, torque = rows["branch"].to_numpy(), rows["torque_Nm"].to_numpy()
    angle = rows["angle_arcmin"].to_numpy()
    pair = centred_loops(np.stack([angle + 0.7, angle - 3.0]), branch, torque)
    np.testing.assert_allclose(pair[0], pair[1], atol=1e-12)
    np.testing.assert_allclose(pair[0], angle, atol=1e-12)


def test_marks_of_the_hysteresis_figure_are_the_metrics_of_the_model():
    rows = loop(0.9, 0.25)
    figure = hysteresis_figure({"tight": loop(0.2, 0.0), "wide": rows}, None, MARKS)
    curve = (rows[name].to_numpy() for name in ("branch", "torque_Nm", "angle_arcmin"))
    branch, levels, angles = curve
    readings = curve_readings(branch, levels, angles[None], np.zeros((1, 2)), np.zeros(1), MARKS)
    numbers = {name: metric.value(readings, MARKS)[0] for name, metric in library().items()}
    arrows = [text for text in figure.axes[1].texts if text.get_text() == ""]
    heights = [arrow.xy[1] - arrow.xyann[1] for arrow in arrows]
    marked = [numbers[name] for name in ("zero_torque_width_arcmin", "lost_motion_arcmin")]
    np.testing.assert_allclose(heights, marked, atol=1e-12)
    torque, angle = next(artist for artist in figure.axes[0].lines if len(artist.get_xdata()) == 3).get_data()
    rigidity = (torque[2] - torque[0]) / (angle[2] - angle[0])
    assert rigidity == pytest.approx(numbers["torsional_rigidity_Nm_per_arcmin"], rel=1e-12)


def test_loop_without_play_and_missing_traces_draw_nothing_false():
    figure = hysteresis_figure({"nominal": loop(0.0, 0.0)}, None, MARKS)
    assert "backlash" not in "".join(text.get_text() for text in figure.axes[1].texts)
    spread = spread_frame(
        np.random.default_rng(1).normal(size=(20, 2)),
        branch=np.array(["loading+", "loading-"]),
        torque_Nm=np.array([1.0, -1.0]),
    )
    assert hysteresis_figure({}, spread, MARKS).axes[0].collections
    assert not hysteresis_figure({}, None, MARKS).axes[0].lines


def test_bearing_figure_keeps_the_directions_apart():
    rows = loop(1.0, 0.0)
    for axes, column in zip(bearing_figure({"a": rows}).axes, ("bearing_x_um", "bearing_y_um"), strict=True):
        assert line(axes, "a").get_ydata().tolist() == rows[column].tolist()


def test_loaded_pins_are_counted_and_drawn_alone(contacts):
    rows = loads(contacts, [70, 71, 73])
    of_pins = rows[rows["contact"] < PINS]
    assert dead_zones_figure({"case": of_pins}).axes[0].get_title(loc="left") == "case: 3 pins in contact"
    force, depth = pin_loads_figure({"case": of_pins}).axes
    shown_part = line(force, "case").get_ydata()
    assert np.flatnonzero(np.isfinite(shown_part)).tolist() == [70, 71, 73]
    assert np.nansum(shown_part) == 70 + 71 + 73
    assert np.nanmax(line(depth, "case").get_ydata()) == 0.5


def test_rising_torques_are_told_apart_by_shade_and_marker(contacts):
    rows = loads(contacts, [70])
    rows = rows[rows["contact"] < PINS]
    lines = pin_loads_figure({"1 N m": rows, "2 N m": rows, "3 N m": rows}, rising=True).axes[0].lines
    assert len({artist.get_marker() for artist in lines}) == 3
    lightness = [np.mean(matplotlib.colors.to_rgb(artist.get_color())) for artist in lines]
    assert lightness == sorted(lightness, reverse=True)


def test_rollers_stand_in_their_interface_from_outside_to_inside(contacts):
    rows = contacts[(contacts["interface"] == 1) & (contacts["face"] == 0) & (contacts["end"] == 0)]
    figure = output_loads_figure({"case": loads(contacts, rows["contact"].tolist())}, contacts, "roller, 0 outside")
    first_axes, second_axes = figure.axes[0], figure.axes[1]
    assert not first_axes.lines
    draws = line(second_axes, "case")
    np.testing.assert_array_equal(draws.get_xdata(), rows["station"])
    np.testing.assert_array_equal(draws.get_ydata(), rows["contact"])


def test_pins_are_numbered_clockwise_and_rows_by_their_contacts(contacts):
    reducer = assembly.reducer(DESIGN, 0.0)
    numbers = np.arange(PINS, len(reducer.contacts))
    panels = DESIGN.output.panels(reducer.disks[0], reducer.contacts.some(numbers), numbers)
    figure = reducer_figure(contacts, [flank_outline(DESIGN, 0.0)] * len(panels), 0.0, 0.8, panels)
    ring, first_order, second = figure.axes
    position = {text.get_text(): text.get_position() for text in ring.texts}
    assert position["0"][0] > DESIGN.cycloid.pin_circle_radius_mm
    assert position["0"][1] == pytest.approx(0.0, abs=1e-9)
    assert position["1"][1] < 0 < position[str(PINS - 1)][1]
    assert sum(text.isdigit() for text in position) == PINS
    rows = contacts[contacts["interface"] == 0]
    labels = {text.get_text() for text in first_order.texts}
    assert f"{rows['contact'].min()}–{rows['contact'].min() + DESIGN.output.stations - 1}" in labels
    assert {str(station) for station in rows["station"]} <= labels
    assert "plate to output" in second.get_title(loc="left")


def test_disk_outline_touches_every_nominal_pin(contacts):
    outline = flank_outline(DESIGN, 0.0)
    point = contacts["x_mm"].to_numpy()[:PINS] + 1j * contacts["y_mm"].to_numpy()[:PINS]
    nearest = np.min(np.abs(outline[None] - point[:, None]), axis=1)
    assert np.max(nearest) < 0.04  # the outline has a point every 0.07 mm


def test_equal_roller_laws_share_a_curve_and_the_tangent_is_dashed(contacts):
    force = np.linspace(0, 100, 11)
    parts = [
        pd.DataFrame(
            {
                "contact": contact,
                "force_N": force,
                "local_um": force * (2 if contact < 0 else 1),
                "stiffness_N_per_um": 1.0 + force,
                "beyond_limit": force > 60,
            }
        )
        for contact in (-1, *contacts["contact"])
    ]
    laws = pd.concat(parts)
    figure = spring_laws_figure(laws, contacts)
    axes = figure.axes
    figure.canvas.draw()
    assert not any("$" in label.get_text() for one in axes for label in one.get_yticklabels())
    assert [text.get_text() for text in axes[1].get_legend().get_texts()] == ["input bearing", "output roller"]
    solid, dashed = axes[1].lines[:2]
    assert np.nanmax(solid.get_xdata()[np.isfinite(solid.get_ydata())]) == 60
    assert dashed.get_xdata()[np.isfinite(dashed.get_ydata())].tolist() == [60, 70, 80, 90, 100]
    laws.loc[laws["contact"] == contacts["contact"].iloc[-20], "local_um"] *= 3
    labels = [text.get_text() for text in spring_laws_figure(laws, contacts).axes[1].get_legend().get_texts()]
    assert labels == ["input bearing", "output roller, disk to plate", "output roller, plate to output"]


def test_close_up_of_the_mesh_sits_on_the_loaded_patch():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    nodes = np.concatenate([[0.0], np.exp(1j * angle)])
    triangles = np.array([[0, 1 + k, 1 + (k + 1) % 60, 0, 0, 0] for k in range(60)])
    patches = np.exp(1j * (angle[::10, None] + np.array([-0.02, 0.0, 0.02])))
    displacement = np.where(np.abs(nodes - np.exp(1j * angle[20])) < 0.01, 5.0, 1.0) + 0j
    close = mesh_figure(nodes, triangles, patches, displacement).axes[1]
    patch_centre = patches[2].mean()
    assert np.mean(close.get_xlim()) == pytest.approx(patch_centre.real)
    assert np.mean(close.get_ylim()) == pytest.approx(patch_centre.imag)
    marked = [artist for artist in close.lines if to_hex(artist.get_color()) == ALARM]
    assert len(marked) == 1
    np.testing.assert_allclose(marked[0].get_xdata(), patches[2].real)


def estimates(metric: str, low: float, high: float) -> pd.DataFrame:
    return pd.DataFrame(
        [(metric, name, value, low, high) for name, value in (("mean", 2.0), ("p05", 1.0), ("p95", 3.0))],
        columns=["metric", "statistic", "value", "ci_low", "ci_high"],
    )


def test_histogram_counts_every_sample_and_draws_undetermined_ends_as_arrows():
    values = pd.DataFrame({"lost_motion_arcmin": np.random.default_rng(3).normal(2.0, 0.5, 300)})
    bounded = distributions_figure(values, estimates("lost_motion_arcmin", 1.5, 2.5), {}, {}).axes[0]
    assert sum(bar.get_height() for bar in bounded.patches) == 300
    assert not [artist for artist in bounded.lines if artist.get_marker() in "<>" and artist.get_marker()]
    open_ended = distributions_figure(values, estimates("lost_motion_arcmin", -np.inf, np.inf), {}, {}).axes[0]
    assert sorted(artist.get_marker() for artist in open_ended.lines).count("<") == 3
    assert sorted(artist.get_marker() for artist in open_ended.lines).count(">") == 3


@pytest.mark.parametrize(
    ("metric", "worse_above"), [("lost_motion_arcmin", True), ("torsional_rigidity_Nm_per_arcmin", False)]
)
def test_ground_beyond_the_limit_is_shaded_on_the_failing_side(metric, worse_above):
    values = pd.DataFrame({metric: np.linspace(1, 3, 50)})
    axes = distributions_figure(values, estimates(metric, 1, 3), {metric: 2.5}, {metric: np.nan}).axes[0]
    shade = axes.patches[-1].get_extents().transformed(axes.transData.inverted())
    assert (shade.x0 if worse_above else shade.x1) == pytest.approx(2.5)
    assert METRICS[metric].smaller_is_worse != worse_above
    assert not [text for text in axes.texts if text.get_text() == "nominal"]


def test_metric_that_does_not_vary_has_one_bar():
    values = pd.DataFrame({"hysteresis_loss_arcmin": np.zeros(7)})
    axes = distributions_figure(values, estimates("hysteresis_loss_arcmin", 0.0, 0.0)[:0], {}, {}).axes[0]
    assert [bar.get_height() for bar in axes.patches] == [7]


def test_crank_figure_without_nominal_sample():
    rows = [
        ("lost_motion_arcmin", crank, name, value)
        for crank in (0.0, 90.0)
        for name, value in (("mean", 2.0 + crank), ("p05", 1.0), ("p95", 3.0))
    ]
    table = pd.DataFrame(rows, columns=["metric", "crank_deg", "statistic", "value"])
    axes = crank_figure(table, pd.DataFrame(columns=["crank_deg"]), ["lost_motion_arcmin"], {}).axes[0]
    assert line(axes, "mean").get_ydata().tolist() == [2.0, 92.0]
    assert [artist.get_label() for artist in axes.lines] == ["mean"]


def indices() -> pd.DataFrame:
    rows = [
        ("pin_radius_mean_um", "rank_correlation", 0.2, 0.15, 0.25),
        ("disk_profile_um", "rank_correlation", -0.6, -0.7, -0.5),
        ("bearing_clearance_um", "rank_correlation", np.nan, np.nan, np.nan),
        ("sum", "first_order", 0.7, 0.6, 0.8),
        ("pin_radius", "first_order", 0.1, -0.1, 0.3),
        ("ovality_2", "first_order", 0.4, 0.35, 0.45),
        ("lobe_profile", "first_order", 0.0, 0.0, 0.0),
        ("sum", "total", 1.4, 1.3, 1.5),
        ("pin_radius", "total", 0.5, 0.4, 0.6),
        ("ovality_2", "total", 0.6, 0.5, 0.7),
        ("lobe_profile", "total", 0.0, 0.0, 0.0),
    ]
    return pd.DataFrame(rows, columns=["parameter", "kind", "index", "ci_low", "ci_high"])


def ranked(axes):
    return [bar.get_width() for bar in sorted(axes.patches, key=lambda bar: bar.get_y())]


def test_drivers_are_ranked_by_size_with_their_sum_last_and_idle_ones_left_out():
    rank, share = sensitivity_figure(indices()).axes
    assert ranked(rank) == [-0.6, 0.2]
    assert [text.get_text() for text in rank.get_yticklabels()] == ["disk profile (whole disk)", "pin radius, mean"]
    titles = [parameter_title(name) for name in ("ovality_2", "pin_radius", "sum")]
    assert [text.get_text() for text in share.get_yticklabels()] == titles
    assert ranked(share) == [0.4, 0.6, 0.1, 0.5, 0.7, 1.4]
    assert share.get_xlim()[1] >= 1.5
    only_rank = indices().assign(index=lambda rows: rows["index"].where(rows["kind"] == "rank_correlation"))
    assert len(sensitivity_figure(only_rank).axes) == 1


def test_an_index_whose_interval_is_as_wide_as_itself_looks_undetermined():
    _, share = sensitivity_figure(indices()).axes
    empty = {bar.get_width() for bar in share.patches if bar.get_facecolor()[3] == 0}
    assert empty == {0.1}
    numbers = {text.get_text() for text in share.texts}
    assert "(0.10)" in numbers
    assert {"0.40", "0.60", "0.70", "1.40"} <= numbers


def test_names_and_numbers_as_people_read_them():
    assert parameter_title("pin_radial_mean_um") == "radial pin position, mean"
    assert parameter_title("ovality_2_amplitude_um") == parameter_title("ovality_2")
    assert parameter_title("something_new_um") == "something new"
    assert signed_number(-0.0004, 2) == "0.00"
    assert signed_number(-1234.5, 1) == "\u22121,234.5"


def test_equal_figures_have_equal_bytes_and_leave_the_settings_alone(tmp_path):
    settings_before = dict(matplotlib.rcParams)
    for name in ("first", "second"):
        save(
            pin_clearances_figure({"a": pd.DataFrame({"contact": [0, 1], "clearance_um": [1.0, 2.0]})}), tmp_path / name
        )
    assert dict(matplotlib.rcParams) == settings_before
    for suffix in ("png", "svg"):
        assert (tmp_path / f"first.{suffix}").read_bytes() == (tmp_path / f"second.{suffix}").read_bytes()

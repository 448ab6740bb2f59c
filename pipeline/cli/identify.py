"""The command identify: the data are judged and answered for before anything that takes long is loaded."""

import argparse

from pipeline import settings
from pipeline.identification.measurement.enough import FEWEST_COMPARED, SINGLE_GROUPS
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.measurement.turning.turning_measurement import TurningMeasurement, read_measurement
from pipeline.identification.measurement.unit_file import load_measured_unit
from pipeline.identification.record.turn_record import TurnRecord


def identify_unit(options: argparse.Namespace) -> None:
    """Say why a measured unit differs from its model, describe a drive without one, or what states share."""
    if options.series:
        from pipeline.cli.questions import identify_series  # as below

        identify_series(options)
        return
    unit = load_measured_unit(options.unit, settings.ROOT)
    measurement = TurnRecord.read(unit) if unit.is_record else read_measurement(unit)
    print("\n".join([*measurement.summary, *plan(measurement)]), flush=True)
    from pipeline.cli.arguments import print_answer, workers  # seconds of imports, behind the first lines
    from pipeline.library.measured import unit_answer

    print_answer(unit_answer(measurement, workers(options)))


def plan(measurement: Measurement | TurnRecord) -> list[str]:
    """What will be done with the data, a line; nothing of data with a fatal fault."""
    if measurement.fatal:
        return []
    if isinstance(measurement, TurnRecord):
        passes, cells = len(measurement.passes), len(measurement.cells)
        return [f"plan: a spring, both senses and the orders of all shafts, fitted to {cells} cells of {passes} passes"]
    unit, cranks = measurement.unit, len(measurement.rows.cranks)
    cycles = len({*measurement.rows.cycle.tolist()})
    turns = unit.settings.crank.moves != "fixed" and bool(measurement.known_cranks)
    if unit.settings.held_out.train:
        split = "what unit.toml holds out judges"
    elif isinstance(measurement, TurningMeasurement):
        held_out_by = measurement.held_out_by
        split = f"each {held_out_by} is predicted from the others" if held_out_by else "nothing can be held out"
    elif max(cranks, cycles) > 1:
        count, parts = (cranks, "crank positions") if cranks > 1 else (cycles, "cycles")
        split = f"{parts_left_out(count, parts, unit.design_study is None and turns)} predicted from the others"
    else:
        split = "nothing can be held out"
    model_text = f"the model of design {unit.settings.design}" if unit.design_study else "play, friction and a spring"
    return [
        f"plan: {model_text}, fitted to {len(measurement.cells)} cells of {len(measurement.branches)} branches; {split}"
    ]


def parts_left_out(count: int, parts: str, in_a_series: bool) -> str:
    """Several positions or cycles as they are left out: each by itself, or many in groups, fewer outside a series."""
    groups = SINGLE_GROUPS if in_a_series else FEWEST_COMPARED
    if count <= SINGLE_GROUPS:
        return f"each of {count} {parts} is"
    return f"{count} {parts} are left out in {groups} groups, each"

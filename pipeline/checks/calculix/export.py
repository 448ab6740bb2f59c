"""The deck of one sample of a study, for an engineer to check us with a program of his own."""

from pathlib import Path

from pipeline.assembly import NMM_PER_NM
from pipeline.checks.calculix.deck import SPAN, calculix_deck
from pipeline.checks.calculix.program import PROGRAM
from pipeline.checks.specimen import SHARES, Specimen, loaded_equilibria
from pipeline.config import Study
from pipeline.engine.store import write_atomic
from pipeline.model.load_history.load_cycle import ARCMIN


def export(study: Study, sample: int, crank_deg: float, folder: Path) -> str:
    """Write the deck of a sample at five output torques, and say where it is and what the study's model answers.

    Raises
    ------
    InputError
        If CalculiX has no spring for the bearing.
    """
    specimen = Specimen(study, sample, crank_deg)
    torque = SHARES * specimen.rated_torque
    states = loaded_equilibria(specimen, torque)
    deck = calculix_deck(specimen, torque, states)
    name = f"sample-{sample}-crank-{crank_deg:g}"
    write_atomic(folder / f"{name}.inp", deck.text.encode())
    rows = [
        f"  {load / NMM_PER_NM:8.4g} N m   {ARCMIN * angle:10.5f} arcmin   {force.max():9.3f} N"
        for load, angle, force in zip(
            torque, states.motion[0, :, specimen.reducer.output_motion], states.force[0], strict=True
        )
    ]
    return "\n".join(
        [
            f"deck: {folder / name}.inp; run it with: {PROGRAM} {name}",
            f"output angle = {ARCMIN * deck.first_angle:.5f} arcmin + {ARCMIN / SPAN:.6g} arcmin/mm times "
            f"displacement 1 of node {deck.output_node};",
            f"contact force i = reaction of node {deck.springs[0]} + i",
            "the study's model: torque, output angle, largest contact force",
            *rows,
        ]
    )

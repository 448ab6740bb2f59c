"""The suite: every check by name, its results as a table, a CSV file and a page of the documentation."""

import csv
import io
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.checks.specimen import Check, Finding, Specimen, skipped_check
from pipeline.checks.verify.balance import check_equilibrium
from pipeline.checks.verify.disks import check_disks, check_turn
from pipeline.checks.verify.elasticity import check_disk_compliance, check_elastic_bodies
from pipeline.checks.verify.flank import check_flank, check_profile
from pipeline.checks.verify.holes import check_holes
from pipeline.checks.verify.laws import check_contact_laws, check_cylinder_between_flats
from pipeline.checks.verify.load_sharing import check_li_guan, check_linear_share
from pipeline.checks.verify.play import check_rigid_backlash
from pipeline.checks.verify.rv import check_rv
from pipeline.checks.verify.whole import check_calculix, check_unreduced
from pipeline.config import Study, load_study
from pipeline.config.mechanisms.carrier import Carrier
from pipeline.config.mechanisms.roller_plate import RollerPlate
from pipeline.engine.store import write_atomic

MESHES = {"coarse": "quick", "paper": "paper"}
"""Study whose mesh and tolerances each size takes."""
CHECKS: Mapping[str, Check] = {
    "profile": check_profile,
    "modified flank": check_flank,
    "rigid backlash": check_rigid_backlash,
    "cylinder between flats": check_cylinder_between_flats,
    "disk compliance": check_disk_compliance,
    "elastic bodies": check_elastic_bodies,
    "contact laws": check_contact_laws,
    "equilibrium": check_equilibrium,
    "linear springs": check_linear_share,
    "Li and Guan": check_li_guan,
    "two disks": check_disks,
    "RV reducer": check_rv,
    "turn": check_turn,
    "whole reducer, scikit-fem": check_unreduced,
    "whole reducer, CalculiX": check_calculix,
    "disk with holes, CalculiX": check_holes,
}
ONE_PLATE = ("rigid backlash", "equilibrium", "linear springs", "whole reducer, scikit-fem", "whole reducer, CalculiX")
"""Checks that are written for one disk on an input bearing, and for the bodies of a sliding plate."""
LINEAR_BEARING = ("equilibrium", "whole reducer, scikit-fem", "whole reducer, CalculiX")
"""Checks whose energy is that of a linear bearing without clearance."""
ONE_ELASTIC_DISK = ("disk compliance", "turn")
"""Checks that condense the disk of the study."""
OF_OWN_DESIGNS = (
    "cylinder between flats",
    "elastic bodies",
    "Li and Guan",
    "two disks",
    "RV reducer",
    "disk with holes, CalculiX",
)
"""Checks of bodies and designs of their own, whatever the study; of an RV reducer its own are checked."""
PLANE_STRAIN = ("whole reducer, scikit-fem", "whole reducer, CalculiX")
"""Checks that compare codes in plane strain, where CalculiX' elements are ours."""
PAGE = Path("data") / "verification.md"
"""In the project's folder; the documented run is at the paper's size."""
COLUMNS = ("check", "quantity", "reference", "computed", "error", "limit", "ok", "seconds")


@dataclass(frozen=True)
class CheckRow:
    """One row of ``results.csv``: a finding, the check that it belongs to, and the time since the row before [s]."""

    check: str
    finding: Finding
    seconds: float

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts in the order of ``COLUMNS``; empty where there is no number."""
        finding = self.finding
        limit = np.nan if finding.limit is None else finding.limit
        numbers = (finding.reference, finding.computed_value, finding.error, limit)
        outcome = "" if finding.ok is None else str(finding.ok)
        texts = ["" if np.isnan(number) else f"{number:.9g}" for number in numbers]
        return (self.check, finding.quantity, *texts, outcome, f"{self.seconds:.3f}")


def run_checks(specimen: Specimen, checks: Mapping[str, Check]) -> Iterator[CheckRow]:
    """Rows of the checks, one by one as they are found."""
    in_strain = specimen.in_stress("plane_strain")
    for name, check in checks.items():
        start = time.perf_counter()
        for finding in check(in_strain if name in PLANE_STRAIN else specimen):
            yield CheckRow(name, finding, time.perf_counter() - start)
            start = time.perf_counter()


def why_not(name: str, study: Study) -> str:
    """Why a check does not apply to a study; empty if it does."""
    design = study.design
    if name in OF_OWN_DESIGNS and not (name == "RV reducer" and isinstance(design.output, Carrier)):
        return "it checks a design of its own, the same for every study; run make verify without STUDY"
    if name == "RV reducer" and design.disk.count != 2:
        return f"its closed forms hold for two opposed disks; this design has {design.disk.count}"
    if name in ONE_PLATE and not isinstance(design.output, RollerPlate):
        parts = f"disks: {design.disk.count}, output: {design.output.name}"
        return f"it solves one disk and a sliding plate; this design has others ({parts})"
    if name in LINEAR_BEARING and (design.bearing.clearance_um or design.bearing.exponent != 1.0):
        return "it solves a linear input bearing without clearance; this design has another"
    if name == "contact laws" and study.springs.law != "hertz":
        return f"it follows the range of the law hertz; this study has the law {study.springs.law}"
    if name in ONE_ELASTIC_DISK and design.disk.count > 1:
        return f"it condenses one disk; this design has {design.disk.count}"
    if name in ONE_ELASTIC_DISK and study.reduce.disk == "rigid":
        return "it condenses the disk; this study has rigid disks"
    if name == "turn" and design.output.holes(design.cycloid):
        return "it condenses a disk that repeats from lobe to lobe; this one has holes"
    return ""


def verify_study(study: Study, results: Path) -> int:
    """Run the checks that apply to a study of any design, print their rows and write the table.

    Returns
    -------
    Number of rows that failed.
    """
    checks = {name: partial(_refused, why) if (why := why_not(name, study)) else CHECKS[name] for name in CHECKS}
    rows = _told_rows(Specimen(study, min(1, study.samples.rows - 1)), checks, results)
    return sum(row.finding.ok is False for row in rows)


def _refused(reason: str, specimen: Specimen) -> Iterator[Finding]:
    yield skipped_check(f"does not apply: {reason}")


def _told_rows(specimen: Specimen, checks: Mapping[str, Check], results: Path) -> list[CheckRow]:
    """Rows of the checks, printed as they are found and written as a table."""
    rows = []
    for row in run_checks(specimen, checks):
        print(line(row), flush=True)
        rows.append(row)
    write_results(rows, results)
    return rows


def verify(mesh: str, root: Path, results: Path) -> int:
    """Run every check, print its rows, write the table and, at the paper's size if no check is skipped, the page.

    Parameters
    ----------
    mesh : ``coarse`` or ``paper``.
    root : the project's folder.
    results : the CSV file to write.

    Returns
    -------
    Number of rows that failed.
    """
    rows = _told_rows(Specimen(load_study(MESHES[mesh], root)), CHECKS, results)
    skipped_checks = {row.check for row in rows if row.finding.is_skipped}
    if mesh == "paper" and skipped_checks:
        print(f"{PAGE} is left as it is: skipped were {', '.join(sorted(skipped_checks))}", flush=True)
    elif mesh == "paper":
        write_atomic(root / PAGE, page(rows, mesh).encode())
    return sum(row.finding.ok is False for row in rows)


def line(row: CheckRow) -> str:
    """A row for the terminal: verdict, check, quantity, computed number, error and limit."""
    finding = row.finding
    verdict = {True: "ok", False: "FAILED", None: "skipped"}[finding.ok]
    if finding.is_skipped:
        return f"{verdict:8}{row.check:26}{finding.quantity}"
    outcome = "" if finding.limit is None else f"error {finding.error:.1e}  limit {finding.limit:.1e}"
    return f"{verdict:8}{row.check:26}{finding.quantity:92}{finding.computed_value:12.5g}  {outcome}"


def write_results(rows: list[CheckRow], path: Path) -> None:
    """Write ``results.csv``."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(row.cells for row in rows)
    write_atomic(path, text.getvalue().encode())


def page(rows: list[CheckRow], mesh: str) -> str:
    """The page: one table a check, its numbers, errors and limits."""
    lines = [
        "# Verification",
        "",
        "Written by `make verify`; do not edit. Code against exact answers and against independent solvers: every",
        f"error must keep its limit. Mesh and tolerances of `data/studies/{MESHES[mesh]}.toml`, sample 1, crank at 0",
        "degrees. Where a quantity has many values, the two that differ most are shown here.",
    ]
    for name, check in CHECKS.items():
        lines += ["", f"## {name[0].upper()}{name[1:]}", "", (check.__doc__ or "").splitlines()[0], ""]
        lines += ["| quantity | reference | computed | error | limit | kept |", "|---|---|---|---|---|---|"]
        lines += [_page_line(row.finding) for row in rows if row.check == name]
    return "\n".join(lines) + "\n"


def _page_line(finding: Finding) -> str:
    def text(number: float | None, form: str) -> str:
        return "" if number is None or np.isnan(number) else format(number, form)

    verdict = "" if finding.limit is None else "yes" if finding.ok else "**no**"
    numbers = (text(finding.reference, ".6g"), text(finding.computed_value, ".6g"), text(finding.error, ".1e"))
    outcome = "skipped" if finding.is_skipped else verdict
    return f"| {' | '.join((finding.quantity, *numbers, text(finding.limit, '.1e'), outcome))} |"

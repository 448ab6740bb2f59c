"""Mesh numbers that follow from the design: a study without them runs, and a finer mesh moves the compliance little."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly, elastic
from pipeline.config import load_design, parse_study
from pipeline.config.studies.optional import lobe_length, with_mesh
from pipeline.config.studies.study import Reduce, Study
from pipeline.errors import InputError

ROOT = Path(__file__).parents[2]


def study_of(name: str, reduce: dict[str, object] | None, **sections: object) -> Study:
    """A shipped study with another section `reduce`, or without one."""
    raw = {**tomllib.loads((ROOT / f"data/studies/{name}.toml").read_text()), **sections}
    raw.pop("reduce")
    raw |= {} if reduce is None else {"reduce": reduce}
    return parse_study(raw, name, f"{name}.toml", lambda design: load_design(design, ROOT))


def pin_compliance(study: Study) -> np.ndarray:
    """Compliance (n, n) of the contacts of the first disk at crank 0, over 2/(pi E' t)."""
    reducer = assembly.reducer(study.design, 0.0)
    disk = elastic.elastic_disk(study)
    steel = study.design.materials[study.design.disk.material]
    unit = 2 / (np.pi * steel.youngs_modulus_MPa * study.design.disk.thickness_mm)
    return disk.compliance(elastic.disk_patches(study, disk, reducer)).matrix / unit


def test_a_study_without_mesh_numbers_has_those_of_its_design():
    study = study_of("paper", None)
    assert study.reduce == Reduce(
        flank_edges_per_lobe=76,
        patch_half_width_mm=0.08,
        growth=0.35,
        largest_edge_mm=1.08,
        roller_patch_half_width_mm=1.2,
    )
    stated = study_of("paper", {"patch_half_width_mm": 0.16}).reduce
    assert (stated.patch_half_width_mm, stated.flank_edges_per_lobe) == (0.16, 38)
    assert study_of("li_guan", {"disk": "rigid"}).reduce.disk == "rigid"


def test_the_edges_of_a_lobe_are_half_of_half_a_patch():
    design = load_design("li_guan", ROOT)
    psi = np.linspace(0, 2 * np.pi, 200_001)
    whole = np.abs(np.diff(assembly.profile(design).flank(psi))).sum()
    assert design.cycloid.lobes * lobe_length(design) == pytest.approx(whole, rel=1e-5)
    mesh = with_mesh({}, design)
    assert whole / design.cycloid.lobes / mesh["flank_edges_per_lobe"] <= 0.5 * mesh["patch_half_width_mm"]


def test_a_design_that_cannot_be_read_hides_no_mesh_and_asks_for_none():
    with pytest.raises(InputError) as raised:
        study_of("paper", None, design="no_such_design")
    assert not [problem for problem in raised.value.problems if "reduce" in problem]


@pytest.mark.parametrize("name", ["li_guan", pytest.param("printed_drive", marks=pytest.mark.attack)])
@pytest.mark.long
def test_a_finer_mesh_than_the_default_moves_no_compliance_by_much(name):
    """Edges shorter by the root of two: a pin deflects by some seven units, so that 0.03 is half a percent of it."""
    study = study_of(name, {"disk": "elastic"})
    reduce = study.reduce
    finer = reduce.model_copy(
        update={
            "flank_edges_per_lobe": round(np.sqrt(2) * reduce.flank_edges_per_lobe),
            "growth": reduce.growth / np.sqrt(2),
            "largest_edge_mm": reduce.largest_edge_mm / np.sqrt(2),
        }
    )
    default, refined = (pin_compliance(study.model_copy(update={"reduce": item})) for item in (reduce, finer))
    pins = study.design.cycloid.pins
    assert np.abs(np.diag(default - refined)[:pins]).max() < 0.03
    off_diagonal = ~np.eye(len(default), dtype=bool)
    assert np.abs((default - refined)[off_diagonal]).max() < 0.01 * np.abs(default[off_diagonal]).max()

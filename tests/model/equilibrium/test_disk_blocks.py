"""Contacts sorted by the bodies that couple them: every compliance found again, in its block or as zero."""

import numpy as np
import pytest

from pipeline.model.equilibrium.blocks import coupled_blocks

BODY = np.array([0, 0, 1, 2, 1, 0, 2, 1, 2, 0])
"""Elastic body of each contact; those of body 2 are rigid."""


def compliance_of(bodies, rigid=()):
    generator = np.random.default_rng(3)
    matrix = generator.uniform(1.0, 2.0, (len(bodies), len(bodies)))
    matrix = (matrix + matrix.T) * (bodies[:, None] == bodies)
    matrix[np.isin(bodies, rigid)] = 0.0
    return matrix


@pytest.mark.parametrize("rigid", [(), (2,), (0, 1, 2)])
def test_every_compliance_is_in_its_block_or_zero(rigid):
    matrix = compliance_of(BODY, rigid)
    blocks = coupled_blocks(matrix)
    rebuilt = np.zeros_like(matrix)
    for block_start, block_end in blocks.ranges:
        rows = blocks.order[block_start:block_end]
        rebuilt[np.ix_(rows, rows)] = blocks.compliance[block_start:block_end, : block_end - block_start]
    np.testing.assert_array_equal(rebuilt, matrix)
    np.testing.assert_array_equal(blocks.self_compliance, np.diag(matrix)[blocks.order])
    np.testing.assert_array_equal(np.sort(blocks.order), np.arange(len(BODY)))
    assert len(blocks.ranges) == max(3 - len(rigid), 1)


def test_one_body_keeps_the_order_of_its_contacts():
    matrix = compliance_of(np.array([0, 1, 0, 0]), rigid=(1,))
    blocks = coupled_blocks(matrix)
    np.testing.assert_array_equal(blocks.order, np.arange(4))
    np.testing.assert_array_equal(blocks.compliance, matrix)

"""Speed of a study: rates per core, the ratio to the least that dense algebra would cost, growth and gain of processes.

Every ratio is formed within one run, on one thread, because machines differ.
"""

from tests.validation.bench.suite import bench
from tests.validation.bench.table import Result, write

__all__ = ["Result", "bench", "write"]

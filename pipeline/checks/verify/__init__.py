"""Code against exact answers and against independent solvers: what must hold before any number of a study counts."""

from pipeline.checks.verify.suite import CHECKS, CheckRow, page, run_checks, verify, verify_study

__all__ = ["CHECKS", "CheckRow", "page", "run_checks", "verify", "verify_study"]

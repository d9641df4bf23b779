"""Owns the validation table: this solver's numbers beside those of independent codes, closed forms and the paper."""

from __future__ import annotations

from collections.abc import Iterator

from solver.case import Case
from solver.check_control import control_rows
from solver.check_linear import linear_rows
from solver.check_nonlinear import nonlinear_rows


def run_checks() -> Iterator[Case]:
    """The validation table, row by row as it is computed."""
    yield from linear_rows()
    yield from nonlinear_rows()
    yield from control_rows()

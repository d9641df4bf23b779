"""The validation table: this solver against independent codes, closed forms and the literature."""

import dataclasses
import json
from pathlib import Path

import pytest

from flutterviz.validation import BEGIN, END, write_into
from solver import DesignError
from solver.case import Case
from solver.check import run_checks

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def table() -> list[Case]:
    return list(run_checks())


def test_every_case_is_within_its_tolerance(table: list[Case]) -> None:
    misses = [f"{c.name}: {c.value} against {c.reference} (tol {c.tol})" for c in table if not c.ok]
    assert not misses, "\n".join(misses)


def test_names_are_unique(table: list[Case]) -> None:
    names = [c.name for c in table]
    assert len(set(names)) == len(names)


def test_cases_are_plain_and_say_who_computed_the_reference(table: list[Case]) -> None:
    for case in table:
        assert json.loads(json.dumps(dataclasses.asdict(case), allow_nan=False)) == dataclasses.asdict(case)
        assert case.source
        assert case.tol > 0


def test_the_papers_own_numbers_stand_beside_ours_without_a_say(table: list[Case]) -> None:
    amplitudes = {c.name: c for c in table if c.name.startswith("limit cycle") and c.seed is not None}
    assert sorted(c.seed for c in amplitudes.values() if c.seed) == [0.35, 0.645, 0.66]
    # the paper's amplitudes are about 0.6 of every independent solution: a row judged by them could not be ok
    assert all(c.ok and c.value and c.seed and c.seed < 0.7 * c.value for c in amplitudes.values())


def test_the_table_comes_row_by_row() -> None:
    assert next(run_checks()).name  # a caller can show progress, and stop by not asking again


def test_readme_carries_this_table(table: list[Case]) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in text.split(BEGIN)[1].split(END)[0].splitlines() if "|" in line]
    assert [row[0] for row in rows[2:]] == [case.name for case in table]
    for row, case in zip(rows[2:], table, strict=True):
        # six digits are printed, and other machines round otherwise; limit cycles come to rest within 1e-3
        assert float(row[1]) == pytest.approx(case.value, rel=1e-3)
        assert float(row[2]) == pytest.approx(case.reference, rel=1e-3)


def test_the_table_is_put_between_the_marks_and_nowhere_else(tmp_path: Path) -> None:
    file = tmp_path / "page.md"
    file.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n", encoding="utf-8")
    case = Case("a | b", 1.0, 2.0, 0.1, False, None, "someone")
    write_into(file, [case])
    text = file.read_text(encoding="utf-8")
    assert text.startswith(f"before\n{BEGIN}\n0 of 1 within tolerance.\n")
    assert text.endswith(f"{END}\nafter\n")
    assert "old" not in text
    assert "a \\| b | 1 | 2 | 5e-01" in text  # a bar within a name would be one more column
    file.write_text("no marks", encoding="utf-8")
    with pytest.raises(DesignError, match="no lines"):
        write_into(file, [case])
    assert file.read_text(encoding="utf-8") == "no marks"
    with pytest.raises(DesignError, match="cannot be read"):
        write_into(tmp_path / "absent.md", [case])

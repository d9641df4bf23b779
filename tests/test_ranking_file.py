"""The file of a ranking and its journal: what is kept, what is refused, and searches that go on from them."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from itertools import islice
from pathlib import Path
from typing import get_args

import msgspec
import pytest
from fakescores import Measured, coarse, measuring, rough

from solver import Design, DesignError, load_design
from solver.ranking import Ranking
from solver.rankingfile import Journal, RankingFile, file_of, read_ranking
from solver.score import LINEAR, Score
from solver.search import Progress, search
from solver.task import Method, Task, task_for

METHODS: tuple[Method, ...] = get_args(Method)
DESIGN = coarse(6, 4)


def task_of(method: Method = "exhaustive") -> Task:
    task = Task(method, elements=None if method == "exhaustive" else 6, top=3, evaluations=70)
    return task_for(task, DESIGN)


def kept(path: Path, task: Task, count: int | None = None, end: bool = True, executor: Executor | None = None) -> None:
    """Search as a command would, with a file; until so many steps are done, and ended well or killed."""
    journal, last = Journal(path, DESIGN, task), None
    steps = search(DESIGN, task, executor, journal.known)
    for last in steps if count is None else islice(steps, count):
        if last.score is not None:
            journal.add(last.score)
    journal.close(last.ranking if end and last is not None else None)


def log_of(path: Path) -> Path:
    return path.with_name(path.name + ".journal")


@pytest.fixture
def whole(tmp_path: Path) -> bytes:
    """The file of a search that was never interrupted."""
    path = tmp_path / "whole.json"
    with measuring(rough("file"), mixed=True):
        kept(path, task_of())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["whole.json"]
    return path.read_bytes()


def test_the_file_holds_the_whole_ranking(whole: bytes, tmp_path: Path) -> None:
    saved = read_ranking(tmp_path / "whole.json")
    with measuring(rough("file"), mixed=True):
        steps: list[Progress] = list(search(DESIGN, task_of()))
    ranking: Ranking = steps[-1].ranking
    assert saved == file_of(ranking)
    assert {s.elements: s for s in saved.scores} == {s.score.elements: s.score for s in steps if s.score is not None}
    assert saved.complete
    assert [place.rank for place in saved.ranking] == [1, 2, 3]
    assert [place.figures for place in saved.ranking] == list(ranking.ranked[:3])
    assert [place.figures for place in saved.front] == list(ranking.front)
    assert [place.figures for place in saved.passive] == list(ranking.passive[:3])
    for place in (*saved.ranking, *saved.front, *saved.passive):
        assert place.design == DESIGN.with_elements(place.figures.elements)
    assert json.loads(whole)["search_version"] == 1


def test_any_place_of_the_file_is_a_design(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "whole.json"
    ranking = read_ranking(path).ranking
    assert load_design(str(path)) == load_design(f"{path}#1") == ranking[0].design
    assert load_design(f"{path}#3") == ranking[2].design
    for rank in (0, 4, 99):
        with pytest.raises(DesignError, match=f"there is no rank {rank}; the ranking has 3 layouts"):
            load_design(f"{path}#{rank}")


def test_a_voltage_limit_of_the_task_is_in_its_designs(tmp_path: Path) -> None:
    task = task_for(Task("nfcg", elements=4, voltage_limit=50.0), DESIGN)
    with measuring():
        kept(tmp_path / "low.json", task)
    assert load_design(str(tmp_path / "low.json")).control.voltage_limit == 50.0
    assert read_ranking(tmp_path / "low.json").design == DESIGN


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("end", [True, False], ids=["ended", "killed"])
def test_a_search_goes_on_from_its_file_to_the_same_file(method: Method, end: bool, tmp_path: Path) -> None:
    """Twice interrupted, at different places; everything is computed once over all three runs."""
    path, task = tmp_path / "ranking.json", task_of(method)
    with measuring(rough("file"), mixed=True) as asked:
        kept(tmp_path / "whole.json", task)
        screens, runs = len(asked.screens), len(asked.runs)
        asked.screens.clear()
        asked.runs.clear()
        for count in (screens // 2, screens + runs // 2 if method == "exhaustive" else screens):
            kept(path, task, count, end)
            assert log_of(path).exists() is not end
        kept(path, task)
    assert path.read_bytes() == (tmp_path / "whole.json").read_bytes()
    assert not log_of(path).exists()
    assert len(asked.screens) == len(set(asked.screens)) == screens
    assert len(asked.runs) == len(set(asked.runs)) == runs


@pytest.mark.parametrize("method", ["genetic", "iterative", "exhaustive"])
def test_allowed_more_layouts_it_finds_what_one_finds_that_was_allowed_them_at_once(
    method: Method, tmp_path: Path
) -> None:
    """A generation that was cut off was measured against other bounds: they must not show."""
    path, longer = tmp_path / "ranking.json", task_of(method)
    with measuring(rough("longer"), mixed=True):
        kept(tmp_path / "whole.json", longer)
        for count in (21, 45):
            kept(path, msgspec.structs.replace(longer, evaluations=count))
        kept(path, longer)
    assert path.read_bytes() == (tmp_path / "whole.json").read_bytes()


def test_fewer_layouts_than_the_file_holds_are_refused(tmp_path: Path) -> None:
    path, task = tmp_path / "ranking.json", task_of()
    with measuring():
        kept(path, task)
    with pytest.raises(DesignError, match="more than evaluations = 3; choose another file"):
        Journal(path, DESIGN, msgspec.structs.replace(task, evaluations=3))


def test_what_was_measured_is_not_lost_by_a_later_interruption(tmp_path: Path) -> None:
    """A second run that is ended at once, while it only reads through what the first had found."""
    path, task = tmp_path / "ranking.json", task_of()
    with measuring(rough("file"), mixed=True) as asked:
        kept(path, task, 60)  # 42 linear figures and 18 runs
        measured = {s.elements: s for s in read_ranking(path).scores if s.state not in LINEAR}
        assert len(measured) > 5
        kept(path, task, 30)
        again = {s.elements: s for s in read_ranking(path).scores}
        assert {e: again[e] for e in measured} == measured
        asked.runs.clear()
        kept(path, task)
    assert not set(asked.runs) & set(measured)


def test_a_file_says_what_was_found_before_even_if_the_next_run_ends_at_once(tmp_path: Path) -> None:
    path, task = tmp_path / "ranking.json", task_of()
    with measuring(rough("file"), mixed=True):
        kept(path, task, 60)
        before = read_ranking(path)
        kept(path, task, 1)
    after = read_ranking(path)
    assert not before.complete
    assert not after.complete
    assert [place.figures for place in after.ranking] == [place.figures for place in before.ranking]


def test_the_finished_file_is_left_as_it_is_without_measuring(whole: bytes, tmp_path: Path) -> None:
    with measuring(rough("file"), mixed=True) as asked:
        kept(tmp_path / "whole.json", task_of())
    assert asked == Measured()
    assert (tmp_path / "whole.json").read_bytes() == whole


def test_workers_that_overtake_each_other_write_the_same_file(whole: bytes, tmp_path: Path) -> None:
    with measuring(rough("file"), mixed=True, delay=4e-3), ThreadPoolExecutor(4) as executor:
        kept(tmp_path / "other.json", task_of(), executor=executor)
    assert (tmp_path / "other.json").read_bytes() == whole


@pytest.mark.parametrize("cut", [1, 40, -1])
def test_a_last_line_that_was_cut_off_does_not_count(cut: int, whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.json"
    with measuring(rough("file"), mixed=True) as asked:
        kept(path, task_of(), 20, end=False)
        lines = log_of(path).read_bytes().splitlines(keepends=True)
        assert len(lines) == 21  # and the header
        log_of(path).write_bytes(b"".join(lines[:-1]) + lines[-1][:cut])
        asked.screens.clear()
        kept(path, task_of())
    assert len(asked.screens) == 42 - 19
    assert path.read_bytes() == whole


def test_a_journal_cut_off_in_its_first_line_begins_anew(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.json"
    log_of(path).write_bytes(b'{"design":{"schema_ver')
    with measuring(rough("file"), mixed=True) as asked:
        kept(path, task_of())
    assert len(asked.screens) == 42
    assert path.read_bytes() == whole


@pytest.mark.parametrize("damage", [b"{]", b'{"elements":[1]}', b"\xff\xfe", b"", b"null"])
def test_a_damaged_line_is_named(damage: bytes, tmp_path: Path) -> None:
    path = tmp_path / "damaged.json"
    with measuring(rough("file"), mixed=True):
        kept(path, task_of(), 20, end=False)
    lines = log_of(path).read_bytes().split(b"\n")
    lines[7] = damage
    log_of(path).write_bytes(b"\n".join(lines))
    with pytest.raises(DesignError, match=r"damaged\.json\.journal: line 8 is damaged") as error:
        Journal(path, DESIGN, task_of())
    assert "\n" not in str(error.value)
    assert log_of(path).read_bytes() == b"\n".join(lines)  # as it was: a user may mend it


Change = Callable[[Design, Task], tuple[Design, Task]]


@pytest.mark.parametrize("end", [True, False], ids=["ended", "killed"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda design, task: (design.with_dynamic_pressure(850.0), task), "on another design"),
        (lambda design, task: (coarse(8, 4), task), "on another design"),
        (lambda design, task: (design, msgspec.structs.replace(task, seed=1)), "with seed = 0, not 1"),
        (
            lambda design, task: (design, msgspec.structs.replace(task, objective="energy")),
            "with objective = robust, not energy",
        ),
        (lambda design, task: (design, msgspec.structs.replace(task, keep_out=(3,))), "with keep_out"),
    ],
)
def test_a_file_of_another_search_is_refused(change: Change, said: str, end: bool, tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    with measuring():
        kept(path, task_of(), 20, end)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    design, task = change(DESIGN, task_of())
    with pytest.raises(DesignError, match=f"holds a search {said}.*; choose another file"):
        Journal(path, design, task)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_patches_of_the_design_and_a_larger_number_of_evaluations_are_the_same_search(tmp_path: Path) -> None:
    path = tmp_path / "same.json"
    with measuring():
        kept(path, task_of(), 20)
    longer = msgspec.structs.replace(task_of(), evaluations=None)
    journal = Journal(path, DESIGN.with_elements((5, 6)), longer)
    journal.close(None)
    assert len(journal.known) == 20


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[1, 2]", b'{"schema_version": 1}', b"\x00\xff", b'{"search_version":1,"ranking":[]}']
)
def test_a_file_that_is_not_a_ranking_is_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_bytes(content)
    with pytest.raises(DesignError, match=r"mine\.json: is not the ranking of a search") as error:
        Journal(path, DESIGN, task_of())
    assert "\n" not in str(error.value)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("mine.json", content)]


def test_a_file_of_another_version_is_refused(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "new.json"
    path.write_bytes(whole.replace(b'"search_version": 1', b'"search_version": 2'))
    with pytest.raises(DesignError, match="search_version = 2: this version reads 1"):
        read_ranking(path)


@pytest.mark.parametrize("place", ["nowhere/ranking.json", "."])
def test_a_folder_that_is_missing_or_no_file_is_refused(place: str, tmp_path: Path) -> None:
    with pytest.raises(DesignError, match="give a file in a folder that exists"):
        Journal(tmp_path / place, DESIGN, task_of())
    assert list(tmp_path.iterdir()) == []


def test_a_score_is_written_once_and_at_once(tmp_path: Path) -> None:
    path = tmp_path / "journal.json"
    journal = Journal(path, DESIGN, task_of())
    score = Score((1, 2), 1, 0.1, "screened", estimate=0.2)
    for _ in range(3):
        journal.add(score)
        assert len(log_of(path).read_bytes().splitlines()) == 2  # before anything is closed
    journal.close(None)
    again = Journal(path, DESIGN, task_of())
    again.close(None)
    assert again.known == [score]


def test_json_of_the_file_reads_back_to_the_last_digit(whole: bytes, tmp_path: Path) -> None:
    saved = read_ranking(tmp_path / "whole.json")
    assert msgspec.json.decode(msgspec.json.encode(saved), type=RankingFile) == saved

"""What is worked out beside the loop belongs to what runs and what was asked for last, in whatever order it comes."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import ParamSpec, TypeVar

import pytest
from pages import DESIGN, rig

from flutterviz import background as beside_loop
from flutterviz.background import Background
from flutterviz.outlook import Outlook, outlook_of
from flutterviz.rig import Rig, rig_of

P = ParamSpec("P")
T = TypeVar("T")


class ByHand(Executor):
    """Keeps what it is asked for until the test does it."""

    def __init__(self) -> None:
        self.asked: list[tuple[Future, Callable[..., object], tuple[object, ...]]] = []

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        future: Future[T] = Future()
        self.asked.append((future, fn, args))
        return future


@pytest.fixture
def executor(monkeypatch: pytest.MonkeyPatch) -> ByHand:
    monkeypatch.setattr(beside_loop, "PATIENCE", 0.0)
    return ByHand()


def looked(background: Background, executor: ByHand, present: Rig) -> Outlook | None:
    """Follow a rig, and let what is asked for be done."""
    background.follow(present)
    while executor.asked:
        future, _, _ = executor.asked.pop()
        future.set_result(outlook_of(present))
        background.follow(present)
    return background.outlook


def test_a_design_that_comes_back_is_looked_at_again(executor: ByHand, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a click and an undo, both before the other design has rested."""
    background, one = Background(executor), rig()
    other = rig_of(DESIGN.with_elements((0, 1)), one)
    assert looked(background, executor, one) is not None
    monkeypatch.setattr(beside_loop, "PATIENCE", 1e9)
    background.follow(other)
    assert background.outlook is None
    assert not executor.asked
    monkeypatch.setattr(beside_loop, "PATIENCE", 0.0)
    outlook = looked(background, executor, one)
    assert outlook is not None
    assert outlook.design == one.design


def test_what_fails_is_tried_once(executor: ByHand) -> None:
    background, one = Background(executor), rig()
    background.follow(one)
    executor.asked.pop()[0].set_exception(ValueError("no"))
    for _ in range(3):
        background.follow(one)
    assert not executor.asked
    assert background.outlook is None


def test_the_trouble_of_another_map_is_not_told(executor: ByHand) -> None:
    background, one = Background(executor), rig()
    looked(background, executor, one)
    background.ask("h2")
    background.follow(one)
    background.ask("nfcg")
    executor.asked.pop()[0].set_exception(ValueError("h2 went wrong"))
    background.follow(one)
    assert background.trouble == ""
    future, _, args = executor.asked.pop()  # and the one wanted now is under way
    assert args[1] == "nfcg"
    future.set_exception(ValueError("so did nfcg"))
    background.follow(one)
    assert background.trouble == "ValueError: so did nfcg"

"""The clock: wall time to simulated time, what the machine can afford, and what the eye can follow."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flutterviz.clock import BUDGET, FRAME, LADDER, LONGEST, SAMPLES_A_CYCLE, Clock, nearest_rate, rate_name

rates = st.sampled_from(LADDER)
seconds = st.floats(0.0, 10.0)


def test_the_ladder_climbs_to_real_time() -> None:
    assert list(LADDER) == sorted(set(LADDER))
    assert LADDER[-1] == 1
    assert len({rate_name(rate) for rate in LADDER}) == len(LADDER)  # the page chooses them by name
    assert (rate_name(1.0), rate_name(1 / 250)) == ("real time", "1/250")


@given(st.floats(1e-5, 10.0))
@settings(deadline=None)
def test_the_first_rate_is_the_rung_nearest_to_a_cycle_in_one_and_a_half_seconds(period: float) -> None:
    rate = nearest_rate(period)
    assert rate in LADDER
    assert all(abs(period / rate - 1.5) <= abs(period / other - 1.5) for other in LADDER)


@given(rates, st.lists(st.floats(0.0, LONGEST), min_size=1, max_size=20))
@settings(deadline=None)
def test_a_machine_that_keeps_up_gives_wall_time_times_the_rate(rate: float, steps: list[float]) -> None:
    clock, now, given_seconds = Clock(rate), 100.0, 0.0
    assert clock.due(now) == pytest.approx(FRAME * rate)  # the first picture has no predecessor to count from
    for step in steps:
        now += step
        given_seconds += clock.due(now)
        assert not clock.capped
    # now - _last loses the digits of 100 s: 1e-14 a step
    assert given_seconds == pytest.approx(rate * sum(steps), abs=1e-12)


@given(rates, st.floats(LONGEST, 1e6))
@settings(deadline=None)
def test_a_stall_is_not_made_up_for(rate: float, stall: float) -> None:
    clock = Clock(rate)
    clock.due(0.0)
    assert clock.due(stall) == pytest.approx(LONGEST * rate)


@given(rates)
@settings(deadline=None)
def test_time_never_runs_backwards(rate: float) -> None:
    clock = Clock(rate)
    clock.due(10.0)
    assert clock.due(9.0) == 0


@given(rates, st.floats(1e-3, 1e3))
@settings(deadline=None)
def test_integration_takes_its_share_of_a_frame_at_most(rate: float, cost: float) -> None:
    clock = Clock(rate)
    clock.due(0.0)
    clock.took(1.0, cost)  # the first report is believed at once
    given_seconds = clock.due(FRAME)
    assert given_seconds * cost <= BUDGET * FRAME * (1 + 1e-12)
    assert clock.capped == (given_seconds < FRAME * rate * (1 - 1e-12))
    assert given_seconds <= FRAME * rate


def test_the_actual_rate_tells_how_far_a_capped_clock_stays_behind() -> None:
    clock, cost = Clock(1.0), 4.0  # four seconds of computing a second of motion: a tenth of real time at most
    for frame in range(200):
        given_seconds = clock.due(frame * FRAME)
        clock.took(given_seconds, cost * given_seconds)
    assert clock.capped
    assert clock.actual == pytest.approx(BUDGET / cost, rel=1e-6)  # smoothed: 0.8^199 of the start is left
    clock.rate = LADDER[0]
    for frame in range(200, 400):
        clock.due(frame * FRAME)
    assert not clock.capped
    assert clock.actual == pytest.approx(LADDER[0], rel=1e-6)


def test_no_time_costs_nothing() -> None:
    clock = Clock(1.0)
    clock.due(0.0)
    clock.took(0.0, 5.0)
    assert clock.due(FRAME) == pytest.approx(FRAME)


@given(rates, st.floats(1e-4, 1.0))
@settings(deadline=None)
def test_fewer_than_eight_pictures_a_cycle_are_called_aliased(rate: float, period: float) -> None:
    assert Clock(rate).aliased(period) == (period / (rate * FRAME) < SAMPLES_A_CYCLE)


def test_the_first_rate_is_never_aliased_on_the_seeds_panel() -> None:
    period = 1 / 140  # s, of the seed's flutter
    assert not Clock(nearest_rate(period)).aliased(period)

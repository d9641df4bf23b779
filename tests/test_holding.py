"""How far a controller holds the panel: damping over phases of the limit cycle, and over dynamic pressure."""

import dataclasses
from functools import lru_cache

import control
import msgspec
import numpy as np
import pytest
from panels import COARSE, balance, plant, seed, whole

from solver import Control, Loop, Plant, Run, limit_cycle, load_design, robust, seed_protocol
from solver.controlfacts import ControlFacts, control_facts
from solver.holding import Hold, hold_over, stabilises_up_to, suppresses_up_to
from solver.limitcycle import DivergedError, LimitCycle
from solver.mesh import Floats
from solver.robust import on_the_cycle, robust_damping, suppresses

SIX = load_design("seed-840")
WEAK = msgspec.structs.replace(
    COARSE, control=Control(voltage_limit=5.0)
)  # the limit, and not the linear loop, decides


@lru_cache
def cycle_of(pressure: float = 840.0) -> LimitCycle:
    """The limit cycle of the seed's six patches."""
    found = limit_cycle(Loop.of(plant(SIX.with_dynamic_pressure(pressure))))
    assert found is not None
    return found


def largest(of: Plant, states: Floats) -> Floats:
    """(samples,) largest |w| over h."""
    return np.abs(states[:, : of.size] @ of.model.coarse.T).max(axis=1) / of.design.panel.thickness


def test_robust_damping_of_the_seed() -> None:
    loop = Loop.of(plant(SIX))
    robust = robust_damping(loop, cycle_of())
    assert robust is not None
    assert len(robust.times) == 8
    # 0.088 to 0.125 s: where eight phases fall on the cycle moves both ends by some samples
    assert 0.08 < robust.times.min() < 0.1
    assert 0.115 < robust.times.max() < 0.135
    assert robust.worst == robust.times.max()
    assert robust.mean == pytest.approx(robust.times.mean())
    assert robust.peak_voltage == loop.law.limit
    time = seed_protocol(loop).damping_time
    assert time is not None
    assert robust.times.min() - 0.01 < time < robust.times.max() + 0.01  # one phase more
    # half a turn later this cycle is the same motion turned over; phases lie so that no two do the same for that
    assert np.diff(np.sort(robust.times)).min() > 0
    assert suppresses(loop, cycle_of())


def test_a_phase_is_an_independent_run_from_its_state() -> None:
    loop = Loop.of(plant(SIX))
    of, cycle = loop.plant, cycle_of()
    robust = robust_damping(loop, cycle, phases=3)
    assert robust is not None
    states = on_the_cycle(loop, cycle, 3)
    for (state, _), time in zip(states, robust.times, strict=True):
        # on the cycle: back at itself after a period
        (back,), _ = loop.stretch(state, 1 / cycle.frequency, 1, engaged=False)
        assert np.abs((back - state) * balance(of)).max() < 1e-2 * np.abs(state * balance(of)).max()
        sample = 1e-4
        run, _ = loop.stretch(state, sample, 4000, engaged=True)
        above = np.flatnonzero(largest(of, run) >= of.design.run.settled)
        assert (above[-1] + 2) * sample == pytest.approx(time, abs=of.period / 32 + sample)
    # the phases are thirds of a period apart, by steps of another length
    (third,), _ = loop.stretch(states[0][0], 1 / (3 * cycle.frequency), 1, engaged=False)
    assert np.abs((third - states[1][0]) * balance(of)).max() < 2e-5 * np.abs(third * balance(of)).max()


def test_an_estimator_has_listened_to_the_cycle() -> None:
    loop = Loop.of(plant(seed("seed-840", 600.0, kind="lqg")))
    of, cycle = loop.plant, limit_cycle(Loop.of(plant(SIX.with_dynamic_pressure(600.0))))
    assert cycle is not None
    ((state, memory), *_) = on_the_cycle(loop, cycle, 2)
    error = np.abs((state - memory.own) * balance(of)).max() / np.abs(state * balance(of)).max()
    assert 1e-3 < error < 0.5  # it knows the motion, but not the stretching that makes it stiffer
    assert suppresses(loop, cycle, phases=2)


def test_nothing_to_damp_is_none() -> None:
    passive = plant(SIX.with_dynamic_pressure(530.0))
    assert passive.passive
    assert robust_damping(Loop.of(passive)) is None
    assert robust_damping(Loop.of(plant(load_design("seed-bare")))) is None
    assert suppresses(Loop.of(passive))
    assert not suppresses(Loop.of(plant(load_design("seed-bare"))))


def test_a_controller_that_is_off_damps_no_phase() -> None:
    off = Loop.of(plant(msgspec.structs.replace(SIX, control=Control(kind="off"))))
    robust = robust_damping(off, cycle_of(), phases=2)
    assert robust is not None
    assert np.isnan(robust.times).all()
    assert robust.worst is None
    assert robust.mean is None
    assert robust.peak_voltage == 0
    assert not suppresses(off, cycle_of(), phases=2)


def unstable(of: Plant) -> bool:
    """Whether python-control's regulator on what it can reach leaves a growing root of all modes."""
    even = plant(of.design)
    weights = of.design.control
    q = weights.state_weight * np.diag(balance(even) ** 2)
    gain, _, _ = control.lqr(even.system_matrix, even.input_matrix, q, weights.effort_weight)
    odd = np.tile(of.model.parity == -1, 2)
    rest = of.system_matrix[odd][:, odd]
    closed = even.system_matrix - even.input_matrix @ gain
    return max(np.linalg.eigvals(m).real.max() for m in (closed, rest)) > 0


def test_six_patches_stabilise_up_to_where_the_antisymmetric_flutter_begins() -> None:
    hold = stabilises_up_to(whole(SIX))
    assert hold is not None
    assert hold.dynamic_pressure == pytest.approx(1114.7, rel=1e-3)  # its resolution
    assert not hold.open_ended
    assert "antisymmetric about y = b/2" in hold.reason
    assert "\n" not in hold.reason
    assert unstable(whole(SIX.with_dynamic_pressure(1.003 * hold.dynamic_pressure)))
    assert not unstable(whole(SIX.with_dynamic_pressure(0.999 * hold.dynamic_pressure)))


def test_six_channels_hold_further_and_weak_rate_feedback_hardly_at_all() -> None:
    six = stabilises_up_to(whole(seed(channels="element", modes=12)))
    assert six is not None
    assert six.dynamic_pressure > 1300
    rate = whole(seed(kind="rate", rate_gain=1e3))
    hold = stabilises_up_to(rate)
    assert hold is not None
    assert rate.critical is not None
    assert rate.critical[0] <= hold.dynamic_pressure < 1.1 * rate.critical[0]
    assert "a motion still grows" in hold.reason


@lru_cache
def weak_holds() -> tuple[Hold, Hold]:
    linear = stabilises_up_to(whole(WEAK))
    assert linear is not None
    nonlinear = suppresses_up_to(whole(WEAK), linear)
    assert nonlinear is not None
    return linear, nonlinear


def test_a_low_limit_suppresses_less_than_it_stabilises() -> None:
    linear, nonlinear = weak_holds()
    critical = whole(WEAK).critical
    assert critical is not None
    assert critical[0] < nonlinear.dynamic_pressure < 0.8 * linear.dynamic_pressure
    assert not nonlinear.open_ended
    assert "limit cycle" in nonlinear.reason
    for factor, ends in ((0.995, True), (1.015, False)):  # its resolution is 0.5 %
        loop = Loop.of(plant(WEAK.with_dynamic_pressure(factor * nonlinear.dynamic_pressure)))
        assert loop.growth.real < 0
        assert suppresses(loop) == ends


def test_it_suppresses_no_further_than_it_stabilises() -> None:
    """With all the voltage one could wish for the limit cycle ends beyond, but small antisymmetric motion grows."""
    strong = msgspec.structs.replace(COARSE, control=Control(voltage_limit=228.6))
    linear = stabilises_up_to(whole(strong))
    assert linear is not None
    assert linear == weak_holds()[0]  # small motions know of no limit
    near = dataclasses.replace(linear, dynamic_pressure=700.0)  # as if small motions were lost there already
    assert suppresses_up_to(whole(strong), near) == near


def test_where_nothing_flutters_or_nothing_drives_there_is_no_hold() -> None:
    bare = whole(COARSE.with_elements(()))
    assert suppresses_up_to(bare, stabilises_up_to(bare)) is None
    never = dataclasses.replace(whole(COARSE))
    vars(never)["critical"] = None  # as on a panel that is stable at any λ: the cached property's own place
    assert stabilises_up_to(never) is None
    assert suppresses_up_to(never, None) is None


def test_rows_over_pressure() -> None:
    """Below the patched λ_cr of 605 passive; then suppressed; beyond 709 V_max is too little."""
    rows = list(hold_over(WEAK.with_dynamic_pressure(650.0), [500.0, 650.0, 800.0]))
    assert [row.dynamic_pressure for row in rows] == [500.0, 650.0, 800.0]
    assert [row.state for row in rows] == ["passive", "suppressed", "not suppressed"]
    calm, damped, lost = rows
    assert calm.open_loop_growth_per_s < 0 < damped.open_loop_growth_per_s < lost.open_loop_growth_per_s
    assert calm.damping_time_s is calm.robust_damping_time_s is None
    assert damped.robust_damping_time_s is not None
    assert damped.mean_damping_time_s is not None
    assert damped.mean_damping_time_s <= damped.robust_damping_time_s
    # made for this λ, the controller that is kept is the same
    assert damped.fixed_robust_damping_time_s == pytest.approx(damped.robust_damping_time_s)
    assert damped.fixed_closed_loop_growth_per_s == pytest.approx(damped.closed_loop_growth_per_s)
    assert lost.closed_loop_growth_per_s is not None
    assert lost.closed_loop_growth_per_s < 0  # of small motions it is
    assert lost.robust_damping_time_s is None
    assert lost.peak_voltage_v == 5.0
    for row in rows:
        assert row.open_loop_growth_per_s == whole(WEAK.with_dynamic_pressure(row.dynamic_pressure)).growth.real


def test_rows_beyond_the_reach_are_suppressed_in_part() -> None:
    """At 1310 an antisymmetric motion grows that one channel cannot reach, while the cycle it damps is symmetric."""
    strong = msgspec.structs.replace(COARSE, control=Control(voltage_limit=228.6)).with_dynamic_pressure(1310.0)
    (row,) = hold_over(strong, [1310.0])
    assert row.state == "suppressed in part"
    assert row.closed_loop_growth_per_s is not None
    assert row.closed_loop_growth_per_s > 0
    assert row.robust_damping_time_s is not None
    (row,) = hold_over(COARSE.with_elements(()), [500.0])
    assert row.state == "stable"


@lru_cache
def facts() -> ControlFacts:
    return control_facts(WEAK.with_dynamic_pressure(680.0), phases=3)


def test_facts_are_those_of_their_parts() -> None:
    found, design = facts(), WEAK.with_dynamic_pressure(680.0)
    loop = Loop.of(whole(design))
    assert found.controller == "lqr"
    assert found.channels == [[5, 6, 9, 10]]
    assert not found.passive
    assert found.open_loop_growth_per_s == whole(design).growth.real
    assert found.closed_loop_growth_per_s == pytest.approx(loop.growth.real, rel=1e-9)
    assert found.pole_growth_per_s[0] == pytest.approx(loop.growth.real, rel=1e-6)
    assert np.all(np.diff(found.pole_growth_per_s) <= 0)
    linear, nonlinear = weak_holds()
    assert found.stabilises_up_to == pytest.approx(linear.dynamic_pressure, rel=1e-9)
    assert found.suppresses_up_to == pytest.approx(nonlinear.dynamic_pressure, rel=6e-3)  # its resolution
    assert len(found.phase_damping_times_s) == 3
    assert found.robust_damping_time_s == max(t for t in found.phase_damping_times_s if t is not None)
    trace = seed_protocol(Loop.of(plant(design)))
    assert found.damping_time_s == trace.damping_time
    assert found.peak_voltage_v == 5.0
    assert found.control_energy_v2s == trace.control_energy
    assert 0 < found.saturated_share < 1
    assert any("antisymmetric" in line for line in found.warnings)


def test_model_error_is_this_controller_on_another_plant() -> None:
    found, design = facts(), WEAK.with_dynamic_pressure(680.0)
    gain = Loop.of(whole(design)).law.gain
    for factor, growth in ((0.9, found.growth_at_lower_per_s), (1.1, found.growth_at_higher_per_s)):
        there = whole(design.with_dynamic_pressure(factor * 680.0))
        roots = np.linalg.eigvals(there.system_matrix - there.input_matrix @ gain)
        assert growth == pytest.approx(roots.real.max(), rel=1e-6)
    assert found.stands_model_error == (max(found.growth_at_lower_per_s, found.growth_at_higher_per_s) <= 0)


def test_without_any_damping_what_does_not_decay_does_not_grow() -> None:
    """At C_a = 0 a mode that is out of reach has a root on the axis, to rounding: the loop is not unstable for that."""
    flow = msgspec.structs.replace(COARSE.flow, damping=0.0)
    design = msgspec.structs.replace(COARSE, flow=flow, control=Control(voltage_limit=228.6))
    design = msgspec.structs.replace(design, run=msgspec.structs.replace(design.run, duration=1.0))
    (row,) = hold_over(design.with_dynamic_pressure(700.0), [700.0])
    assert row.robust_damping_time_s is not None
    assert row.closed_loop_growth_per_s == pytest.approx(0.0, abs=1e-6)
    assert row.state == "suppressed"


def test_energy_and_work_are_of_the_time_under_control() -> None:
    of = plant(SIX)
    trace = seed_protocol(Loop.of(of))
    run, time = of.design.run, trace.damping_time
    assert time is not None
    kept = (trace.times >= run.control_on - 1e-9) & (trace.times <= run.control_on + time + 1e-9)
    step = trace.times[1]
    # plain sums for trapezoids: they differ by half of both ends
    assert trace.control_energy == pytest.approx(step * (trace.volts[kept] ** 2).sum(), rel=0.02)
    charge = trace.states[kept, : of.size] @ of.force[:, 0]
    stieltjes = float((0.5 * (trace.volts[kept, 0][1:] + trace.volts[kept, 0][:-1]) * np.diff(charge)).sum())
    assert trace.drive_work == pytest.approx(stieltjes, abs=0.05 * trace.peak_voltage * np.abs(np.diff(charge)).sum())


def test_a_run_with_no_time_for_control_says_nothing_of_it() -> None:
    design = msgspec.structs.replace(COARSE, run=Run(control_on=0.3, duration=0.3)).with_dynamic_pressure(700.0)
    plant = Plant.of(design)
    assert plant.flutters
    assert robust_damping(Loop.of(plant.symmetric())) is None
    assert suppresses_up_to(plant, stabilises_up_to(plant)) is None


def test_what_diverges_or_has_no_time_is_not_suppressed(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = Loop.of(Plant.of(COARSE).symmetric())
    assert suppresses(loop)
    rest = msgspec.structs.replace(COARSE, run=Run(control_on=0.3, duration=0.3))
    assert not suppresses(Loop.of(Plant.of(rest).symmetric()))

    def diverges(_: Loop, start: object = None) -> None:
        raise DivergedError

    monkeypatch.setattr(robust, "settled_motion", diverges)
    assert not suppresses(loop)
    monkeypatch.setattr(robust, "settled_motion", lambda _, start=None: None)  # at rest in a deflection
    assert suppresses(loop)

"""Exponential steps: against classical ones that are much shorter, and their order."""

import dataclasses

import msgspec
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

from solver import Loop, Plant, Ply, first_mode_at_rest, limit_cycle, load_design
from solver.exponential import Forces, integrate, weights_of
from solver.mesh import Floats
from solver.polynomial import force_table, monomials
from solver.propagator import PARTS, Propagator
from solver.simulate import SAMPLES_A_PERIOD, Memory
from solver.vonkarman import LargeDeflection, membrane_force

SEED = Plant.of(load_design("seed-840").with_reduction("patched", 8))


def random_law(rng: np.random.Generator, modes: int, coupled: bool) -> LargeDeflection:
    pairs = modes * (modes + 1) // 2
    root = rng.standard_normal((pairs, pairs))
    return LargeDeflection(root @ root.T, rng.standard_normal((pairs, modes)) if coupled else np.zeros((0, modes)))


@given(st.integers(1, 9), st.booleans(), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_polynomial_is_the_plain_law(modes: int, coupled: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    law, q = random_law(rng, modes, coupled), rng.standard_normal(modes)
    table = force_table(law)
    cubes, squares = modes * (modes + 1) * (modes + 2) // 6, modes * (modes + 1) // 2
    assert table.shape == (modes, cubes + (squares if coupled else 0))
    size = np.abs(table) @ np.abs(monomials(q, coupled))  # of the sums before they cancel: rounding is relative to it
    np.testing.assert_allclose(table @ monomials(q, coupled), -membrane_force(law, q), rtol=0, atol=1e-13 * size.max())


@dataclasses.dataclass(frozen=True)
class System:
    """ẋ = A x + B p(x), random."""

    a: Floats
    law: LargeDeflection
    forces: Forces

    @staticmethod
    def random(seed: int, modes: int, channels: int, memory: int, coupled: bool) -> "System":
        rng = np.random.default_rng(seed)
        law, size = random_law(rng, modes, coupled), 2 * modes + memory
        a = rng.standard_normal((size, size))
        a[:modes] = 0.0
        a[:modes, modes : 2 * modes] = np.eye(modes)
        forces = Forces(
            force_table(law),
            1.0,
            rng.standard_normal(modes),
            rng.standard_normal((modes, channels)),
            rng.standard_normal((memory, channels)),
            rng.standard_normal((channels, size)),
            0.3,  # about half the voltages are cut
        )
        return System(a, law, forces)

    @property
    def inputs(self) -> Floats:
        n = len(self.forces.load)
        return np.eye(len(self.a))[:, n:]

    def volts(self, x: Floats) -> Floats:
        return np.clip(-self.forces.gain @ x, -self.forces.limit, self.forces.limit)

    def nonlinear(self, x: Floats) -> Floats:
        """(F,) p(x), in plain numpy."""
        n, volts = len(self.forces.load), self.volts(x)
        rates = self.forces.load - membrane_force(self.law, x[:n]) + self.forces.force @ volts
        return np.concatenate([rates, self.forces.driven @ volts])

    def moved(self, x: Floats, step: float, substeps: int, samples: int) -> tuple[Floats, Floats]:
        """States and voltages after each sample, as many as there are before it diverges."""
        states, volts = np.full((samples, len(x)), np.nan), np.full((samples, len(self.forces.gain)), np.nan)
        own = Propagator.of(self.a, self.inputs, step)
        count = integrate(x, *weights_of(own), self.forces, substeps, states, volts)
        assert np.isfinite(states).all(axis=1).sum() == count
        return states[:count], volts[:count]


def phi(matrix: Floats, order: int) -> Floats:
    """φ_k of a matrix by its series: Σ Zʲ / (j + k)!"""
    term, total = np.eye(len(matrix)) / scipy.special.factorial(order), np.zeros_like(matrix)
    for k in range(60):
        total = total + term
        term = term @ matrix / (order + k + 1)
    return total


def reference_step(system: System, x: Floats, h: float) -> Floats:
    """ETD4RK as Cox and Matthews write it, in plain numpy; parted where a voltage meets or leaves its limit."""
    y, kinked = etd4rk(system, x, h)
    if not kinked:
        return y
    for _ in range(PARTS):
        x, _ = etd4rk(system, x, h / PARTS)
    return x


def etd4rk(system: System, x: Floats, h: float) -> tuple[Floats, bool]:
    z, b = h * system.a, system.inputs
    half, kick = scipy.linalg.expm(z / 2), h / 2 * phi(z / 2, 1) @ b
    first = system.nonlinear(x)
    a = half @ x + kick @ first
    second = system.nonlinear(a)
    c = half @ x + kick @ second
    third = system.nonlinear(c)
    d = half @ a + kick @ (2 * third - first)
    fourth = system.nonlinear(d)
    one, two, three = (phi(z, k) for k in (1, 2, 3))
    y = scipy.linalg.expm(z) @ x + h * (
        (one - 3 * two + 4 * three) @ b @ first
        + (2 * two - 4 * three) @ b @ (second + third)
        + (4 * three - two) @ b @ fourth
    )
    limit = system.forces.limit
    sides = [np.sign(u) * (np.abs(u) > limit) for u in (-system.forces.gain @ s for s in (x, a, c, d))]
    return y, any((side != sides[0]).any() for side in sides)


@given(
    seed=st.integers(0, 2**32 - 1),
    modes=st.integers(1, 7),
    channels=st.integers(0, 3),
    memory=st.integers(0, 4),
    coupled=st.booleans(),
    substeps=st.integers(1, 3),
)
@settings(max_examples=60, deadline=None)
def test_the_kernel_is_etd4rk(seed: int, modes: int, channels: int, memory: int, coupled: bool, substeps: int) -> None:
    system = System.random(seed, modes, channels, memory, coupled)
    x = np.random.default_rng(seed).standard_normal(len(system.a)) / 3
    before, step = x.copy(), 0.02
    states, volts = system.moved(x, step, substeps, 3)
    np.testing.assert_array_equal(x, before)
    for sample in range(3):
        for _ in range(substeps):
            x = reference_step(system, x, step)
        # sums are reordered; motions of size 1 that random forces of size 100 throw about
        np.testing.assert_allclose(states[sample], x, rtol=1e-9, atol=1e-9 * np.abs(x).max())
        np.testing.assert_allclose(volts[sample], system.volts(states[sample]), rtol=1e-12, atol=1e-12)


@given(
    seed=st.integers(0, 2**32 - 1),
    modes=st.integers(1, 14),
    coupled=st.booleans(),
    exponent=st.integers(-12, 3),
)
@settings(max_examples=40, deadline=None)
def test_single_precision_of_the_law_is_double_to_its_rounding(
    seed: int, modes: int, coupled: bool, exponent: int
) -> None:
    """Whatever the size of the amplitudes, as long as the unit is of that size; zeros may follow the coefficients."""
    system, unit = System.random(seed, modes, 1, 0, coupled), 10.0**exponent
    plain = system.forces
    table = np.zeros((modes, plain.table.shape[1] + seed % 40), np.float32)
    table[:, : plain.table.shape[1]] = unit * plain.table
    scaled = Forces(table, unit, unit * plain.load, unit * plain.force, plain.driven, plain.gain / unit, plain.limit)
    start = np.random.default_rng(seed).standard_normal(2 * modes) / 3
    double, volts = system.moved(start, 0.01, 1, 3)
    single, driven = dataclasses.replace(system, forces=scaled).moved(unit * start, 0.01, 1, 3)
    # forces of size 100 n², of 6e-8 each, in three steps of 0.01
    np.testing.assert_allclose(single / unit, double, rtol=0, atol=1e-5 * np.abs(double).max())
    np.testing.assert_allclose(driven, volts, rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", ["seed-840", "mach-2"])
def test_single_precision_of_the_law_moves_no_figure(name: str) -> None:
    single = Loop.of(Plant.of(load_design(name)).symmetric())
    double = dataclasses.replace(single, precision=np.float64)
    plant, sample = single.plant, single.plant.period / SAMPLES_A_PERIOD
    cycle, exact = limit_cycle(single), limit_cycle(double)
    assert cycle is not None
    assert exact is not None
    assert cycle.amplitude == pytest.approx(exact.amplitude, rel=1e-6)
    assert cycle.frequency == pytest.approx(exact.frequency, rel=1e-6)
    one, two = (loop.stretch(exact.state, sample, 400, engaged=True)[0][:, : plant.size] for loop in (single, double))
    heights = plant.model.coarse.T / plant.design.panel.thickness
    assert np.abs((one - two) @ heights).max() < 1e-6


def test_a_run_that_diverges_ends() -> None:
    system = System.random(5, 3, 1, 0, coupled=False)
    states, volts = system.moved(np.full(6, 1e150), 0.01, 1, 10)
    assert len(states) == len(volts) == 0


def test_a_linear_system_is_exact_at_any_step() -> None:
    """A step of forty radians of the highest mode, no force but a constant one."""
    rng = np.random.default_rng(2)
    a = np.zeros((8, 8))
    a[:4, 4:] = np.eye(4)
    a[4:, :4], a[4:, 4:] = -np.diag([1.0, 4.0, 100.0, 1600.0]), -0.1 * np.eye(4)
    load, x = rng.standard_normal(4), rng.standard_normal(8)
    none = Forces(np.zeros((4, 0)), 1.0, load, np.zeros((4, 0)), np.zeros((0, 0)), np.zeros((0, 8)), 1.0)
    own = Propagator.of(a, np.eye(8)[:, 4:], 1.0)
    states = np.empty((3, 8))
    assert integrate(x, *weights_of(own), none, 1, states, np.empty((3, 0))) == 3
    rest = np.concatenate([load / np.array([1.0, 4.0, 100.0, 1600.0]), np.zeros(4)])
    for k in range(3):
        exact = rest + scipy.linalg.expm(a * (k + 1)) @ (x - rest)
        np.testing.assert_allclose(states[k], exact, rtol=0, atol=1e-11 * np.abs(x).max())


@pytest.mark.parametrize("engaged", [False, True])
def test_the_order_is_four(engaged: bool) -> None:
    """By halving the step, on a motion of the size of the panel's thickness under a drive that is not limited."""
    plant, law = SEED, dataclasses.replace(Loop.of(SEED).law, limit=1e9)
    start = first_mode_at_rest(plant, 0.8 * plant.design.panel.thickness)
    ends = []
    for parts in (1, 2, 4, 64):
        loop = dataclasses.replace(Loop.of(plant, law), precision=np.float64)
        sample = loop._long_step / parts * (1 - 1e-9)
        ends.append(loop.stretch(start, sample, 64 * parts, engaged)[0][-1])
    errors = [np.abs((end - ends[-1])[: plant.size] * plant.model.peak).max() for end in ends[:-1]]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.5)  # the next order is still of some size at the first
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.25)


@pytest.mark.parametrize(("name", "apart"), [("seed-840", 1e-4), ("mach-2", 1e-4), ("seed-1200", 3e-4)])
def test_default_step_is_as_good_as_an_adaptive_run(name: str, apart: float) -> None:
    """Within 1e-4 h of DOP853 at rtol 1e-10 over the first 50 ms of the controlled phase, from what flutter leads to.

    At λ = 1200 that is no cycle, and neighbouring motions part: 2e-4 h, as classical steps do at a third of the step.
    """
    plant = Plant.of(load_design(name)).symmetric()
    loop, n = Loop.of(plant), plant.size
    cycle, _ = loop.stretch(first_mode_at_rest(plant, 1e-4), 0.2, 1, engaged=False)
    sample = plant.period / SAMPLES_A_PERIOD
    count = int(0.05 / sample)
    states, volts = loop.stretch(cycle[0], sample, count, engaged=True)
    gain, limit = loop.law.direct(plant.force), loop.law.limit

    def rate(_: float, x: Floats) -> Floats:
        drive = np.clip(-gain @ x, -limit, limit)
        return np.concatenate(
            [
                x[n:],
                plant.model.load - loop.linear @ x - membrane_force(plant.model.membrane, x[:n]) + plant.force @ drive,
            ]
        )

    scale = np.concatenate([plant.model.omega, np.ones(n)])
    exact = scipy.integrate.solve_ivp(
        rate,
        (0.0, sample * count),
        cycle[0],
        "DOP853",
        t_eval=sample * np.arange(1, count + 1),
        rtol=1e-10,
        atol=1e-12 * np.abs(scale * cycle[0]).max() / scale,
    ).y.T
    shapes = plant.model.coarse.T / plant.design.panel.thickness
    assert np.abs((states - exact)[:, :n] @ shapes).max() < apart
    assert np.abs(volts).max() > 0.5 * limit


def test_classical_and_exponential_steps_agree() -> None:
    """With a controller that remembers, too: as a page runs, here at an eighth of the step, and as a run does."""
    control = msgspec.structs.replace(SEED.design.control, kind="lqg")
    loop = Loop.of(Plant.of(SEED.design.with_control(control), SEED.model))
    start = first_mode_at_rest(loop.plant, 0.5 * loop.plant.design.panel.thickness)
    states, volts, memory = loop.run(start, Memory.blank(loop.law), 1e-4, 300, engaged=True)
    plain, driven, other = loop.advance(start, Memory.blank(loop.law), 1.25e-5, 2400, engaged=True)
    # the estimator's fastest pole turns a radian in a step
    size = np.abs(plain).max(axis=0)
    assert (np.abs(states - plain[7::8]).max(axis=0) <= 5e-3 * size).all()
    np.testing.assert_allclose(volts, driven[7::8], rtol=0, atol=5e-3 * loop.law.limit)
    assert np.abs(memory.own - other.own).max() < 5e-3 * np.abs(other.own).max()


@pytest.mark.parametrize("pressure", [500.0, 700.0])
def test_strong_flutter_of_layers_that_are_not_symmetric_stays_bounded(pressure: float) -> None:
    """Eight times λ_cr, in few modes: what the membrane stiffens is not in the exponential."""
    seed = load_design("seed-840").with_reduction("patched", 8).with_dynamic_pressure(pressure)
    plies = tuple(Ply("graphite-epoxy", angle, 0.000635) for angle in (0.0, 90.0))
    design = msgspec.structs.replace(seed, panel=msgspec.structs.replace(seed.panel, plies=plies))
    loop = Loop.of(Plant.of(design).symmetric())
    start = first_mode_at_rest(loop.plant, 0.1 * design.panel.thickness)
    sample = loop.plant.period / SAMPLES_A_PERIOD
    heights = loop.plant.model.coarse.T / design.panel.thickness
    coarse, fine = (
        np.abs(loop.stretch(start, sample / parts, 1000 * parts, False)[0][:, : loop.plant.size] @ heights).max()
        for parts in (1, 8)
    )
    assert coarse == pytest.approx(fine, rel=0.05)  # a motion of ten times h that is not periodic: 4 %

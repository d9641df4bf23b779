"""Owns the passive effect of one more patch: what its mass and stiffness alone do to growth, for every element."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from solver.aerodynamics import Stream
from solver.assembly import PlateMatrices
from solver.bases import Complexes
from solver.design import Design
from solver.flutter import GROWTH_NOISE, GUIDE, system_matrix
from solver.laminate import Laminate
from solver.mesh import Floats, Ints
from solver.modes import ModalModel

RIVALS = 0.2  # of |s|: roots that grow by so much less than the leading one may come to lead
MARGIN = 0.4  # of |s|: how far outside the roots of today those of the patched panel are looked for
LOWEST = 4  # roots that are looked at where none grows
OFFSET = 1.03  # keeps the centre off the root it is to be near, where the matrix is singular
SEPARATE = (14, 24)  # how many roots of the present panel, from and to, are taken out of its compliance
FEW = 16  # roots that are looked at where only the leading one is wanted
DENSE = 100  # unknowns and rates up to which all eigenvalues are sought at once
SAMPLES = 24  # points of the circle: the next root left in is two radii off or more, and 2⁻²⁴ is 6e-8
REMAINDER = 1e-6  # what the last two of its powers may have of the first, or a pole was left in
TINY = 1e-30  # of an inverse distance: in place of none
REACH = 1.5  # of the radius: a root on its way to the circle may come from so far
ROUNDS = 12  # of linear problems, three or four of which do
CONVERGED = 1e-10  # of |s|
STEP = 1e-5  # of |s|, for derivatives that only steer the iteration


def patch_growth(design: Design) -> Floats:
    """What one more pair of layers without control does to the flat, uncontrolled panel, element by element.

    The growth rate is that of the leading root near those that grow fastest today, or near the lowest four if none
    grows; the change is finite and exact, with every mode of the mesh. Heat strains a panel according to its patches:
    there each patched panel is assembled and solved by itself, in a few times the time.

    Returns:
        (elements,) change of the growth rate at the design's λ [1/s]: negative where a patch would calm the panel, NaN
        where there is one already.
    """
    plate, stream, patched = PlateMatrices.of(design), Stream.of(design), design.patches.elements
    mesh, region = plate.space.mesh, _Region.of(design, plate, stream)
    image = np.array([mesh.mirror_image((e,))[0] for e in range(mesh.elements)])
    if not plate.mirrored or stream.sine:
        image = np.arange(mesh.elements)
    # of two mirror images one is enough: the other does the same
    asked = np.setdiff1d(np.minimum(image, np.arange(mesh.elements)), np.array(patched, dtype=int))
    pencil = _Pencil.of(plate, stream, region.unit)
    heated = design.load.temperature or design.load.temperature_centre
    then = np.full(len(asked), np.nan) if heated else _patched_growth(design, plate, pencil, region, asked)
    for k in np.flatnonzero(np.isnan(then)):
        other = PlateMatrices.of(design.with_elements((*patched, int(asked[k]))))
        then[k] = _Pencil.of(other, stream, region.unit).growth(region)
    growth = np.full(mesh.elements, np.nan)
    growth[asked] = growth[image[asked]] = region.unit * (then - pencil.growth(region))
    return growth


@dataclass(frozen=True)
class _Region:
    """The circle in the complex plane in which roots are looked for, and a unit in which it is of order one."""

    unit: float  # distance of the centre from 0 [1/s], the unit of s from here on
    centre: complex
    radius: float

    @staticmethod
    def of(design: Design, plate: PlateMatrices, stream: Stream) -> _Region:
        """About the roots that grow fastest, as some forty modes have them."""
        guide = ModalModel.of(design.with_reduction("patched", min(GUIDE, plate.stiffness.shape[0])), plate)
        roots = np.linalg.eigvals(system_matrix(guide, stream, stream.dynamic_pressure))
        roots = roots[roots.imag >= 0]
        leading = roots[np.argmax(roots.real)]
        if leading.real > GROWTH_NOISE * guide.omega[0]:
            roots = roots[roots.real > max(leading.real - RIVALS * abs(leading), 0.0)]
        else:
            roots = roots[np.argsort(np.abs(roots))][:LOWEST]
        low, high = (complex(end(roots.real), end(roots.imag)) for end in (np.min, np.max))
        centre = OFFSET * (low + high) / 2
        unit = abs(centre)
        return _Region(unit, centre / unit, float(np.abs(roots - centre).max()) / unit + MARGIN)


@dataclass(frozen=True)
class _Pencil:
    """P(s) = s² M + s C + K of the flat panel in its stream, over what `PlateMatrices.linear` is over."""

    stiffness: sp.csr_array
    damping: sp.csr_array
    mass: sp.csr_array

    @staticmethod
    def of(plate: PlateMatrices, stream: Stream, unit: float) -> _Pencil:
        """With preload and heat, at the stream's λ, for s in a unit [1/s]."""
        pressure, space = stream.dynamic_pressure, plate.space
        slope = stream.slope_unit * (stream.cosine * space.slope_x + stream.sine * space.slope_y)
        stiffness, mass = plate.linear(loaded=True)
        stiffness = sp.csr_array((stiffness + pressure * plate.widened(slope)) / unit**2)
        return _Pencil(stiffness, sp.csr_array(plate.widened(space.bare_mass) * (stream.rate(pressure) / unit)), mass)

    @property
    def transposed(self) -> _Pencil:
        """The one whose right eigenvectors are this one's left ones."""
        return _Pencil(*(sp.csr_array(matrix.T) for matrix in (self.stiffness, self.damping, self.mass)))

    def nearest(self, centre: complex, count: int) -> tuple[Complexes, Complexes]:
        """Eigenvalues nearest to a point, nearest first (count,), and eigenvectors (unknowns, count), by Arnoldi."""
        import scipy.sparse.linalg as spla  # here, because it is slow to import

        n = self.mass.shape[0]
        if 2 * n <= DENSE:
            zero, one = np.zeros((n, n)), np.eye(n)
            left = np.block([[zero, one], [-self.stiffness.toarray(), -self.damping.toarray()]])
            values, vectors = scipy.linalg.eig(left, scipy.linalg.block_diag(one, self.mass.toarray()))
            values, vectors = values[np.isfinite(values)], vectors[:, np.isfinite(values)]
        else:
            factor = spla.splu((self.stiffness + centre * self.damping + centre**2 * self.mass).tocsc())

            def inverse(state: Complexes) -> Complexes:
                x, v = state[:n], state[n:]
                displacement = factor.solve(np.asarray(-(self.mass @ (v + centre * x)) - self.damping @ x))
                return np.concatenate([displacement, x + centre * displacement]).astype(np.complex128)

            operator = spla.LinearOperator((2 * n, 2 * n), matvec=inverse, dtype=np.complex128)
            start = np.random.default_rng(0).standard_normal(2 * n).astype(complex)  # blind to no symmetry
            inverses, vectors = spla.eigs(operator, count, v0=start)
            values = centre + 1 / inverses
        order = np.argsort(np.abs(values - centre))[:count]
        return values[order], vectors[:n, order]

    def growth(self, region: _Region) -> float:
        """Of the fastest growing one of the roots in the region, or of those near it if it is empty."""
        values, _ = self.nearest(region.centre, FEW)
        inside = values[np.abs(values - region.centre) < region.radius]
        return float(np.real(inside if len(inside) else values).max())

    def compliance(self, s: Complexes, number: Ints, line: Ints) -> Complexes:
        """(points, elements, k, k) blocks of P(s)⁻¹ at points s, between the unknowns `number` (elements, k) of each.

        Elements touch two lines of nodes across the panel: those before and after are eliminated line by line.
        """
        present, line = np.unique(line, return_inverse=True)  # a clamped end has no unknowns
        s, count = s[:, None, None], len(present)
        lines = [np.flatnonzero(line == i) for i in range(count)]

        def block(i: int, j: int) -> Complexes:
            K, C, M = (m[lines[i]][:, lines[j]].toarray() for m in (self.stiffness, self.damping, self.mass))
            return s**2 * M + s * C + K

        own = [block(i, i) for i in range(count)]
        down, up = ([block(i + a, i + 1 - a) for i in range(count - 1)] for a in (0, 1))
        before, after = own.copy(), own.copy()
        for i in range(1, count):
            before[i] = own[i] - up[i - 1] @ np.linalg.solve(before[i - 1], down[i - 1])
            after[-1 - i] = own[-1 - i] - down[-i] @ np.linalg.solve(after[-i], up[-i])
        blocks = np.zeros((len(s), *number.shape, number.shape[1]), dtype=complex)
        first = np.where(number < 0, count, line[number]).min(axis=1)
        for i in range(count - 1):
            pair = np.linalg.inv(np.block([[before[i], down[i]], [up[i], after[i + 1]]]))
            place = np.full(len(line) + 1, -1)  # held dofs take the place at the end, of zeros
            place[np.concatenate(lines[i : i + 2])] = np.arange(pair.shape[1])
            local = place[number[first == i]]
            padded = np.pad(pair, ((0, 0), (0, 1), (0, 1)))
            blocks[:, first == i] = padded[:, local[:, :, None], local[:, None, :]]
        return blocks


def _patched_growth(design: Design, plate: PlateMatrices, pencil: _Pencil, region: _Region, asked: Ints) -> Floats:
    """Growth of the leading root in the region with a pair of layers on each element; NaN where not surely found.

    With P⁻¹ = V (sG - H)⁻¹ Wᵀ + R in the region, R without poles there, and a change ΔP on an element, s is a root if
    (sG - H + Wᵀ ΔP (1 + R ΔP)⁻¹ V) a = 0: as many equations as there are roots near, which hardly bend with s. Made
    linear at the centre they give all roots roughly, and then each exactly, by successive linear problems (Ruhe, SIAM
    J. Numer. Anal. 10, 1973, 674-689).
    """
    number, line = _unknowns(plate)
    ends = np.stack(pencil.stiffness.tocoo().coords)
    tied = np.ptp(line[ends], axis=0).max() > 1  # by a straight edge along the flow: there are no lines to eliminate
    near = None if tied or 2 * len(line) <= DENSE else _near(pencil, region)
    if near is None:
        return np.full(len(asked), np.nan)
    number, G, H = number[asked], *near[2:]
    V, W = (np.pad(part, ((0, 1), (0, 0)))[number] for part in near[:2])  # (asked, k, n)
    points = region.centre + region.radius * np.exp(2j * np.pi * np.arange(SAMPLES) / SAMPLES)
    singular = np.array([V @ np.linalg.solve(s * G - H, W.transpose(0, 2, 1)) for s in points])
    # R by its Taylor series about the centre, in powers of the radius
    powers = np.fft.fft(pencil.compliance(points, number, line) - singular, axis=0) / SAMPLES
    stiffness, mass = _pair(design, plate, region.unit)
    size = np.abs(powers @ (region.centre**2 * mass + stiffness)).max(axis=(2, 3))
    sure = size[-2:].max(axis=0) <= REMAINDER * size[0]

    def parts(s: Complexes, element: Ints) -> tuple[Complexes, Complexes, Complexes]:
        """1 + R ΔP (pairs, k, k), Wᵀ ΔP (pairs, n, k), sG - H (pairs, n, n) for pairs of s and a place in `asked`."""
        s = s[:, None, None]
        z, R = (s - region.centre) / region.radius, np.zeros((len(s), *powers.shape[2:]), dtype=complex)
        for power in powers[::-1]:
            R = R * z + power[element]
        change = s**2 * mass + stiffness
        return np.eye(len(mass)) + R @ change, W[element].transpose(0, 2, 1) @ change, s * G - H

    def problem(s: Complexes, element: Ints) -> Complexes:
        """(pairs, n, n) matrices of the equations."""
        local, force, modal = parts(s, element)
        return modal + force @ np.linalg.solve(local, V[element])

    def whole(s: Complexes, element: Ints) -> Complexes:
        """(pairs, k + n, k + n) the same before the element's own dofs are eliminated: straighter, but larger."""
        local, force, modal = parts(s, element)
        return np.block([[local, V[element]], [-force, modal]])

    def steps(matrix: Callable[[Complexes, Ints], Complexes], s: Complexes, element: Ints) -> Complexes:
        """(pairs, …) ways to the roots, were the equations linear."""
        here = matrix(s, element)
        inverse = np.linalg.eigvals(np.linalg.solve(here, (here - matrix(s + STEP, element)) / STEP))
        return np.asarray(1 / np.where(inverse == 0, TINY, inverse), dtype=np.complex128)

    ways = steps(whole, np.full(len(asked), region.centre), np.arange(len(asked)))
    element, root = np.nonzero(np.abs(ways) < REACH * region.radius)
    s, growth = region.centre + ways[element, root], np.full(len(asked), -np.inf)
    for _ in range(ROUNDS):
        ways = steps(problem, s, element)
        way = ways[np.arange(len(s)), np.abs(ways).argmin(axis=1)]
        s, there = s + way, np.abs(way) < CONVERGED
        found = there & (np.abs(s - region.centre) < region.radius)
        np.maximum.at(growth, element[found], s[found].real)
        going = ~there & (np.abs(s - region.centre) < REACH * region.radius)
        s, element = s[going], element[going]
    sure[element] = False
    return np.where(sure & np.isfinite(growth), growth, np.nan)


def _near(pencil: _Pencil, region: _Region) -> tuple[Complexes, Complexes, Complexes, Complexes] | None:
    """V, W (unknowns, n) and G, H (n, n) of V (sG - H)⁻¹ Wᵀ, what the n roots near the region make of P⁻¹.

    There are so many that a wide gap follows them; None if right and left ones do not come out alike.
    """
    other, (low, high) = pencil.transposed, SEPARATE
    (values, x), (same, y) = (one.nearest(region.centre, high + 1) for one in (pencil, other))
    far, as_far = np.abs(values - region.centre), np.abs(same - region.centre)
    n = low + int(np.argmax(far[low : high + 1] / far[low - 1 : high]))
    if not np.allclose(far[:n], as_far[:n], rtol=1e-4):
        return None
    # over displacements and rates; bases of the spaces stay good where two eigenvectors meet, as flutter begins
    V = np.linalg.qr(np.vstack([x, values * x])[:, :n]).Q
    W = np.linalg.qr(np.vstack([other.damping @ y + other.mass @ (same * y), y])[:, :n]).Q
    (x, v), (p, q) = np.split(V, 2), np.split(W, 2)
    return x, q, p.T @ x + q.T @ (pencil.mass @ v), p.T @ v - q.T @ (pencil.stiffness @ x + pencil.damping @ v)


def _pair(design: Design, plate: PlateMatrices, unit: float) -> tuple[Floats, Floats]:
    """(k, k) stiffness, over the unit of s squared, and mass that a pair of layers adds to its element's dofs."""
    bare, patched = (Laminate.of(design.with_elements(elements)) for elements in ((), (0,)))
    space = plate.space
    stiffness = np.einsum("ab,abij->ij", patched.bending[0] - bare.bending[0], space.curvature_integrals)
    mass = (patched.mass[0] - bare.mass[0]) * space.mass_integral
    if plate.coupling is not None:  # a pair is symmetric, and adds none
        membrane = np.einsum("ab,abij->ij", patched.extension[0] - bare.extension[0], space.membrane_integrals)
        stiffness, mass = (scipy.linalg.block_diag(*m) for m in ((stiffness, membrane), (mass, 0 * membrane)))
    return stiffness / unit**2, mass


def _unknowns(plate: PlateMatrices) -> tuple[Ints, Ints]:
    """(elements, k) unknowns of each element, -1 where held, those in the plane too if coupled; their lines (size,)."""
    mesh = plate.space.mesh
    lines = np.arange(mesh.nx + 1).repeat(mesh.ny + 1)  # of nodes across the panel
    kinds = [(mesh.bending_unknowns, mesh.bending_dofs, 4), (mesh.inplane_unknowns, mesh.inplane_dofs, 2)]
    number, line = [], []
    for unknowns, dofs, each in kinds[: 1 if plate.coupling is None else 2]:
        here = np.zeros(unknowns.max() + 2, dtype=int)
        here[unknowns] = lines.repeat(each)  # that of held ones goes to the end, and is dropped
        number.append(np.where(unknowns < 0, -1, unknowns + sum(map(len, line)))[dofs])
        line.append(here[:-1])
    return np.hstack(number), np.concatenate(line)

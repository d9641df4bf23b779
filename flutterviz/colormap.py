"""The colour scales of displacements and of element maps: tables, colours as a browser must be sent them, legends."""

from collections.abc import Sequence
from functools import cache
from html import escape
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

# The page draws with three.js, which passes every colour, unlit ones too, through a filmic tone map (ACES, exposure 1)
# before it becomes sRGB. A colour that should arrive unchanged is sent through the inverse of that map, which has a
# closed form: nothing is fitted here. Colours that the map cannot produce are moved to ones that it can *in the table
# itself*, so that plate, legend and recordings always show the same colour for the same number.

Rgb = tuple[int, int, int]

# Blue (down) to red (up) at equal steps of the displacement. Laid out in OKLCh: lightness falls alike on both arms,
# from 0.865 at rest to 0.44 at the ends, while chroma rises and hue turns slowly. Rest is a grey that stands out from a
# white page and from a dark one; the red arm stays clear of orange, which belongs to the patches.
_DIVERGING: Final = (
    "1e4ca6 2860b8 3674c7 4987d2 609ada 7aacde 96bcdf b3c9dc d2d2d2 "
    "dfbdb5 e3a699 e18e7e db7566 d05b50 c3423d b2262c 9e001d"
)
# Pale grey-green (little) to deep teal (much), a scale of its own beside the blue, grey and red one. Laid out in OKLCh
# too: lightness falls evenly from 0.90, which stands out from a white page, to 0.47, which stands out from the lines of
# the grid and from a dark page. Hue stays green for long and turns to teal only where the scale is already darker than
# the grey of "no number": to eyes that confuse red with green, teal of that grey's lightness would be that grey.
_SEQUENTIAL: Final = "d1e2d3 b5d7ba 9cc9a2 86ba8b 71aa77 5b9b67 3e8b63 187b67 08686b"
_ENTRIES: Final = 256
# Darker than rest and than the pale end, so that "no number" never looks like "no displacement" or "little".
_MISSING: Final = (128, 128, 128)

# three.js, tonemapping_pars_fragment: sRGB to the tone map's space, and back. Rows act on (r, g, b).
_ACES_IN: Final = ((0.59719, 0.35458, 0.04823), (0.07600, 0.90834, 0.01566), (0.02840, 0.13383, 0.83777))
_ACES_OUT: Final = ((1.60475, -0.53108, -0.07367), (-0.10208, 1.10813, -0.00605), (-0.00327, -0.07276, 1.07602))
_ACES_EXPOSURE: Final = 1.0 / 0.6  # three.js brightens by this at toneMappingExposure = 1

_STOPS: Final = 33  # colours of a legend's bar; a browser blends between them
_ALONG: Final = np.linspace(0.0, 1.0, _STOPS)
_ALONG_DIVERGING: Final = 2.0 * _ALONG - 1.0
_OUTLINE: Final = ' stroke="currentColor" stroke-opacity="0.5"'


def display_rgb(values: ArrayLike) -> NDArray[np.uint8]:
    """Colours as they should be seen.

    Args:
        values: (N,) displacement over the scale's limit [-], clipped to -1..1; NaN gives a grey of its own.

    Returns:
        (N, 3) sRGB [0..255].
    """
    return _tables(_DIVERGING)[0][_rows(_shares(values))]


def gltf_rgba(values: ArrayLike) -> NDArray[np.uint16]:
    """Vertex colours that the viewer's tone map turns into `display_rgb(values)`, to within 2 of 255.

    Args:
        values: (N,) displacement over the scale's limit [-], clipped to -1..1; NaN as in `display_rgb`.

    Returns:
        (N, 4) linear red, green, blue and an opaque alpha, normalised [0..65535], as glTF's COLOR_0 takes them.
    """
    return _looked_up(_tables(_DIVERGING)[1], _rows(_shares(values)))


def sequential_rgb(values: ArrayLike) -> NDArray[np.uint8]:
    """Colours of a map as they should be seen, light for little and dark for much.

    Args:
        values: (N,) share of the map's range [-], clipped to 0..1; NaN gives a grey of its own.

    Returns:
        (N, 3) sRGB [0..255].
    """
    return _tables(_SEQUENTIAL)[0][_rows(values)]


def sequential_rgba(values: ArrayLike) -> NDArray[np.uint16]:
    """Vertex colours that the viewer's tone map turns into `sequential_rgb(values)`, to within 2 of 255.

    Args:
        values: (N,) share of the map's range [-], clipped to 0..1; NaN as in `sequential_rgb`.

    Returns:
        (N, 4) linear red, green, blue and an opaque alpha, normalised [0..65535], as glTF's COLOR_0 takes them.
    """
    return _looked_up(_tables(_SEQUENTIAL)[1], _rows(values))


def single(rgb: Rgb) -> NDArray[np.uint16]:
    """One fixed colour as `gltf_rgba` gives them, for a part of the scene that shows no displacement.

    Args:
        rgb: sRGB as it should be seen [0..255]; the nearest colour that the tone map reaches is taken.

    Returns:
        (4,) linear red, green, blue and an opaque alpha, normalised [0..65535].
    """
    return _encode(np.array([rgb]))[0]


def tone_mapped(rgba: ArrayLike) -> NDArray[np.float64]:
    """What a browser shows for vertex colours of an unlit material: three.js' ACES tone map, then sRGB.

    Args:
        rgba: (N, 4) linear colours, normalised [0..65535].

    Returns:
        (N, 3) sRGB, not rounded [0..255].
    """
    scene = np.asarray(rgba, dtype=float)[..., :3] / 65535.0
    film = scene @ np.transpose(_ACES_IN) * _ACES_EXPOSURE
    film = (film * (film + 0.0245786) - 0.000090537) / (film * (0.983729 * film + 0.4329510) + 0.238081)
    linear = np.clip(film @ np.transpose(_ACES_OUT), 0.0, 1.0)
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def legend_svg(limit: float, unit: str = "", *, title: str = "w / h", vertical: bool = False, length: int = 240) -> str:
    """A compact legend; text and outline take the page's text colour, so it reads on light and on dark.

    Args:
        limit: displacement at either end of the scale [unit].
        unit: the unit's sign, put behind the title; empty for a ratio.
        title: what is shown, as "w / h".
        vertical: bar upright with its maximum on top, instead of lying with its maximum on the right.
        length: length of the colour bar [px].

    Returns:
        One `<svg>` element, to be placed in a page or saved as a file.
    """
    name = escape(f"{title} [{unit}]" if unit else title)
    high, low = f"+{limit:.3g}", f"\N{MINUS SIGN}{limit:.3g}"
    direction = 'x1="0" y1="1" x2="0" y2="0"' if vertical else 'x1="0" y1="0" x2="1" y2="0"'
    thick, margin = 12, 26  # the margin holds half of the widest tick label
    if vertical:
        size, bar = (70, length + 36), (4, 26, thick, length)
        labels = [_text(4, 13, name, "start", bold=True)]
        labels += [_text(thick + 12, 30 + at * length, tick, "start") for at, tick in ((0, high), (0.5, "0"), (1, low))]
        ticks = [f"M{thick + 4} {26 + at * length:g}h4" for at in (0, 0.5, 1)]
    else:
        size, bar = (length + 2 * margin, 52), (margin, 20, length, thick)
        labels = [_text(margin + length / 2, 13, name, "middle", bold=True)]
        labels += [_text(margin + at * length, 48, tick, "middle") for at, tick in ((0, low), (0.5, "0"), (1, high))]
        ticks = [f"M{margin + at * length:g} {20 + thick}v4" for at in (0, 0.5, 1)]
    parts = _bar(f"flutterviz-scale-{'v' if vertical else 'h'}", direction, bar, ticks, display_rgb(_ALONG_DIVERGING))
    return _svg(size, f"{name}: {low} to {high}", parts + _words(labels))


def map_legend_svg(
    low: str, high: str, *, title: str, diverging: bool = False, length: int = 240, missing: str = ""
) -> str:
    """A compact legend of an element map: a lying bar, its title over it and the words for its ends below it.

    Args:
        low: what the left end stands for, with its unit if it has one.
        high: what the right end stands for.
        title: what is shown.
        diverging: the blue, grey and red scale with 0 in its middle, instead of the sequential one.
        length: length of the colour bar [px]; each end's words may fill a little less than half of it.
        missing: words for elements without a number, shown beside a swatch of their colour; empty for none.

    Returns:
        One `<svg>` element, to be placed in a page or saved as a file.
    """
    name, start, end, absent = escape(title), escape(low), escape(high), escape(missing)
    thick, margin = 12, 26  # as in `legend_svg`, so that one can take the other's place
    # Words of any length start or end with the bar, where centred ones would leave the picture.
    labels = [_text(margin + length / 2, 13, name, "middle", bold=True), _text(margin, 48, start, "start")]
    labels.append(_text(margin + length, 48, end, "end"))
    if diverging:
        labels.append(_text(margin + length / 2, 48, "0", "middle"))
    ticks = [f"M{margin + at * length:g} {20 + thick}v4" for at in ((0, 0.5, 1) if diverging else (0, 1))]
    colours = display_rgb(_ALONG_DIVERGING) if diverging else sequential_rgb(_ALONG)
    identity = f"flutterviz-map-{'diverging' if diverging else 'sequential'}"
    parts = _bar(identity, 'x1="0" y1="0" x2="1" y2="0"', (margin, 20, length, thick), ticks, colours)
    if missing:
        grey = sequential_rgb([np.nan])[0].tolist()  # the same in both tables
        parts += f'<rect x="{margin}" y="58" width="{thick}" height="{thick}" rx="2" fill="{_code(grey)}"{_OUTLINE}/>'
        labels.append(_text(margin + thick + 6, 68, absent, "start"))
    return _svg((length + 2 * margin, 76 if missing else 52), f"{name}: {start} to {end}", parts + _words(labels))


def _svg(size: tuple[int, int], label: str, content: str) -> str:
    width, height = size
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{label}"'
        f' width="{width}" height="{height}" viewBox="0 0 {width} {height}" style="max-width:100%">{content}</svg>'
    )


def _bar(
    identity: str, direction: str, box: tuple[int, int, int, int], ticks: Sequence[str], colours: NDArray[np.uint8]
) -> str:
    """A colour bar with tick marks.

    Args:
        identity: the gradient's id. Ids are global to a page: two gradients that differ must not share one.
        direction: where the gradient runs, as attributes of a `<linearGradient>`.
        box: x, y, width and height [px].
        ticks: SVG paths of the tick marks.
        colours: (`_STOPS`, 3) sRGB at equal steps from the bar's low end to its high one [0..255].
    """
    x, y, width, height = box
    return (
        f'<defs><linearGradient id="{identity}" {direction}>{_gradient_stops(colours)}</linearGradient></defs>'
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="2" fill="url(#{identity})"{_OUTLINE}/>'
        f'<path d="{"".join(ticks)}" stroke="currentColor" fill="none"/>'
    )


def _words(labels: Sequence[str]) -> str:
    return f'<g fill="currentColor" font-family="system-ui, sans-serif" font-size="12">{"".join(labels)}</g>'


def _text(x: float, y: float, text: str, anchor: str, *, bold: bool = False) -> str:
    weight = ' font-weight="600"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}"{weight}>{text}</text>'


def _gradient_stops(colours: NDArray[np.uint8]) -> str:
    return "".join(
        f'<stop offset="{at:.5g}" stop-color="{_code(rgb)}"/>' for at, rgb in zip(_ALONG, colours.tolist(), strict=True)
    )


def _code(rgb: Sequence[int]) -> str:
    """A colour as SVG takes it, "#rrggbb"."""
    return f"#{bytes(rgb).hex()}"


def _shares(values: ArrayLike) -> NDArray[np.float64]:
    """Values in -1..1 as shares of that range, 0..1."""
    return (np.asarray(values, dtype=float) + 1.0) * 0.5


def _rows(shares: ArrayLike) -> NDArray[np.intp]:
    """Rows of a table for shares of its range, 0..1; the last row, past the scale, stands for NaN."""
    scaled = np.asarray(shares, dtype=float) * (_ENTRIES - 1)
    scaled = np.minimum(np.maximum(np.rint(scaled), 0.0), _ENTRIES - 1.0)  # which pass NaN on
    missing = np.isnan(scaled)
    if missing.any():
        scaled = np.where(missing, float(_ENTRIES), scaled)
    return scaled.astype(np.intp)


def _looked_up(table: NDArray[np.uint16], rows: NDArray[np.intp]) -> NDArray[np.uint16]:
    """(N, 4) rows of a table, each taken as one number of eight bytes: five times as fast as four of two."""
    return table.view(np.uint64)[:, 0].take(rows).view(np.uint16).reshape(*rows.shape, 4)


@cache
def _tables(control_points: str) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """(257, 3) colours seen and (257, 4) colours sent, the last row for NaN."""
    points = np.array([list(bytes.fromhex(code)) for code in control_points.split()], dtype=float)
    at = np.linspace(0.0, len(points) - 1.0, _ENTRIES)
    wanted = np.stack([np.interp(at, np.arange(len(points)), channel) for channel in points.T], axis=1)
    sent = np.ascontiguousarray(_encode(np.vstack([wanted, _MISSING])))
    seen = np.rint(tone_mapped(sent)).astype(np.uint8)
    for table in (seen, sent):
        table.setflags(write=False)
    return seen, sent


def _encode(rgb: ArrayLike) -> NDArray[np.uint16]:
    """(N, 3) sRGB [0..255] to (N, 4) colours to send: `tone_mapped` backwards, clipped to what can be sent."""
    srgb = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    film = np.linalg.solve(np.array(_ACES_OUT), linear.T).T
    # The film curve is a ratio of quadratics in each channel; its inverse is the positive root of a v^2 + b v + c = 0.
    a = 1.0 - 0.983729 * film
    b = 0.0245786 - 0.4329510 * film
    c = -0.000090537 - 0.238081 * film
    film = (-b + np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))) / (2.0 * a)
    scene = np.linalg.solve(np.array(_ACES_IN), film.T).T / _ACES_EXPOSURE
    opaque = np.ones((len(scene), 1))
    return np.rint(65535.0 * np.hstack([np.clip(scene, 0.0, 1.0), opaque])).astype(np.uint16)

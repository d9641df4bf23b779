"""Owns how an authority map is shown: a colour for every element, and the legend that goes with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flutterviz import colormap
from solver.authority import AuthorityMap

DECADES = 100.0  # ratio of the ends of a map beyond which it is shown by its logarithm


def element_colours(shown: AuthorityMap) -> NDArray[np.uint16]:
    """(elements, 4) vertex colours: the darker, the better; of a signed map those of the displacement."""
    shares = _shares(shown)
    return colormap.gltf_rgba(shares) if _signed(shown) else colormap.sequential_rgba(shares)


def legend(shown: AuthorityMap) -> str:
    """The legend as HTML: title, ends with unit, and what the dark end means."""
    values = shown.values[np.isfinite(shown.values)]
    if not len(values):
        return f'<div style="text-align:center;font-size:.8em">{shown.title}: no element has a value</div>'
    missing = shown.note if len(values) < len(shown.values) else ""
    title = f"{shown.title} [{shown.unit}]"
    if _signed(shown):
        end = float(np.abs(values).max())
        svg = colormap.map_legend_svg(f"\u2212{end:.3g}", f"+{end:.3g}", title=title, diverging=True, missing=missing)
        said = "blue calms the panel, red excites it"
    else:
        ends = (values.min(), values.max()) if shown.better == "larger" else (values.max(), values.min())
        svg = colormap.map_legend_svg(f"{ends[0]:.3g}", f"{ends[1]:.3g}", title=title, missing=missing)
        said = "dark: patches belong here" + (" · logarithmic" if _logarithmic(shown) else "")
    text = f'<div style="opacity:.75">{said}</div>'
    return f'<div style="text-align:center;font-size:.8em;padding-bottom:8px">{svg}{text}</div>'


def _signed(shown: AuthorityMap) -> bool:
    return shown.criterion == "growth"


def _logarithmic(shown: AuthorityMap) -> bool:
    values = shown.values[np.isfinite(shown.values)]
    return bool(len(values) and values.min() > 0 and values.max() > DECADES * values.min())


def _shares(shown: AuthorityMap) -> NDArray[np.floating]:
    """(elements,) place on the scale: 0 (worst) to 1 (best), or -1 to 1 about zero; NaN without a value."""
    values = shown.values
    if not np.isfinite(values).any():
        return np.full(len(values), np.nan)
    if _signed(shown):
        return values / max(float(np.nanmax(np.abs(values))), 1e-300)
    if _logarithmic(shown):
        values = np.log(values)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    share = (values - low) / (high - low) if high > low else np.where(np.isnan(values), np.nan, 1.0)
    return share if shown.better == "larger" else 1.0 - share

"""The colour scale: symmetric, reachable through the viewer's tone map, and safe for any number."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from flutterviz import colormap

SCALE = np.linspace(-1.0, 1.0, 256)
SVG = "{http://www.w3.org/2000/svg}"


def lightness(rgb: np.ndarray) -> np.ndarray:
    """CIE L* of (N, 3) sRGB colours [0..100]."""
    srgb = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    return 116.0 * np.cbrt(luminance) - 16.0


def test_what_the_browser_shows_is_the_table() -> None:
    error = colormap.tone_mapped(colormap.gltf_rgba(SCALE)) - colormap.display_rgb(SCALE)
    assert np.abs(error).max() <= 0.51  # the table is what is sent, tone-mapped and rounded


def test_the_table_is_made_of_the_colours_that_were_wanted() -> None:
    ends = colormap.display_rgb([-1.0, 0.0, 1.0]).astype(int)
    wanted = [(0x1E, 0x4C, 0xA6), (0xD2, 0xD2, 0xD2), (0x9E, 0x00, 0x1D)]
    assert np.abs(ends - wanted).max() <= 2  # 256 entries have none at exactly zero: half a step is 1


@pytest.mark.parametrize("rgb", [(28, 32, 40), (210, 210, 210), (158, 0, 29), (120, 120, 120)])
def test_a_single_colour_survives_the_tone_map(rgb: colormap.Rgb) -> None:
    rgba = colormap.single(rgb)
    assert rgba.shape == (4,)
    assert rgba[3] == 65535
    assert np.abs(colormap.tone_mapped(rgba) - rgb).max() <= 2.0


def test_both_arms_are_equally_light_and_darken_outwards() -> None:
    levels = lightness(colormap.display_rgb(SCALE))
    # Designed with equal OKLCh lightness; CIE L* weighs saturated blue and red a little differently.
    assert np.abs(levels - levels[::-1]).max() < 7.0
    assert (np.diff(levels[:128]) > -0.3).all()  # rounding to 8 bits is worth 0.2
    assert (np.diff(levels[128:]) < 0.3).all()


def test_rest_stands_out_from_white_and_from_black_pages() -> None:
    rest = lightness(colormap.display_rgb([0.0]))[0]
    assert 100.0 - rest > 12.0
    assert rest - lightness(np.array([[20, 20, 20]]))[0] > 50.0


def test_values_are_clipped_and_nan_is_a_grey_outside_the_scale() -> None:
    odd = colormap.display_rgb([-np.inf, -7.0, 7.0, np.inf, np.nan])
    low, high = colormap.display_rgb([-1.0, 1.0])
    np.testing.assert_array_equal(odd[:4], [low, low, high, high])
    assert np.ptp(odd[4].astype(int)) <= 1
    assert not (colormap.display_rgb(SCALE) == odd[4]).all(axis=1).any()
    assert colormap.gltf_rgba([np.nan]).dtype == np.uint16


@pytest.mark.parametrize("vertical", [False, True])
def test_the_legend_shows_the_table_and_its_limits(vertical: bool) -> None:
    svg = ElementTree.fromstring(colormap.legend_svg(1.5, "mm", title="w < 1", vertical=vertical))
    texts = [element.text for element in svg.iter(f"{SVG}text")]
    assert sorted(texts, key=str) == sorted(["w < 1 [mm]", "\N{MINUS SIGN}1.5", "0", "+1.5"])
    stops = [element.get("stop-color") for element in svg.iter(f"{SVG}stop")]
    r, g, b = colormap.display_rgb([1.0])[0]
    assert stops[-1] == f"#{r:02x}{g:02x}{b:02x}"

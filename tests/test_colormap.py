"""The colour scales: symmetric or even, reachable through the viewer's tone map, and safe for any number."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from flutterviz import colormap

SCALE = np.linspace(-1.0, 1.0, 256)
SHARES = np.linspace(0.0, 1.0, 256)
SVG = "{http://www.w3.org/2000/svg}"


def lightness(rgb: np.ndarray) -> np.ndarray:
    """CIE L* of (N, 3) sRGB colours [0..100]."""
    srgb = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ np.array([0.2126, 0.7152, 0.0722])
    return 116.0 * np.cbrt(luminance) - 16.0


def oklab(rgb: np.ndarray) -> np.ndarray:
    """(N, 3) OKLab of (N, 3) sRGB colours; a distance of 0.02 is just noticed."""
    srgb = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    cones = [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566]]
    cones.append([0.0883024619, 0.2817188376, 0.6299787005])
    axes = [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099]]
    axes.append([0.0259040371, 0.7827717662, -0.8086757660])
    return np.cbrt(linear @ np.transpose(cones)) @ np.transpose(axes)


def distances(rgb: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(N, M) OKLab distances between (N, 3) and (M, 3) sRGB colours."""
    return np.linalg.norm(oklab(rgb)[:, None] - oklab(others)[None], axis=-1)


def seen_without_green_cones(rgb: np.ndarray) -> np.ndarray:
    """(N, 3) sRGB colours as deuteranopes see them (Machado et al. 2009)."""
    srgb = np.asarray(rgb, dtype=float) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    rows = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    linear = np.clip(linear @ np.transpose(rows), 0.0, 1.0)
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


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


def test_what_the_browser_shows_is_the_sequential_table() -> None:
    values = [*SHARES, np.nan]
    sent, seen = colormap.sequential_rgba(values), colormap.sequential_rgb(values)
    assert (sent.dtype, sent.shape, seen.dtype, seen.shape) == (np.uint16, (257, 4), np.uint8, (257, 3))
    assert (sent[:, 3] == 65535).all()
    assert np.abs(colormap.tone_mapped(sent) - seen).max() <= 0.51


def test_the_sequential_table_is_made_of_the_colours_that_were_wanted() -> None:
    # The tone map cannot make every green: one that it cannot would come out as another colour than was laid out.
    wanted = [(0xD1, 0xE2, 0xD3), (0x71, 0xAA, 0x77), (0x08, 0x68, 0x6B)]
    assert np.abs(colormap.sequential_rgb([0.0, 0.5, 1.0]).astype(int) - wanted).max() <= 2


def test_the_sequential_scale_darkens_evenly() -> None:
    seen = colormap.sequential_rgb(SHARES)
    assert (np.diff(lightness(seen)) < 0.3).all()  # rounding to 8 bits is worth 0.2
    even = oklab(seen)[:, 0]
    assert np.abs(even - np.linspace(even[0], even[-1], 256)).max() < 0.01
    assert even[0] - even[-1] > 0.4


def test_the_sequential_scale_reads_on_white_and_on_dark_pages() -> None:
    pale, dark = lightness(colormap.sequential_rgb([0.0, 1.0]))
    assert 100.0 - pale > 10.0
    assert dark - lightness(np.array([[20, 20, 20]]))[0] > 25.0


@pytest.mark.parametrize(
    ("other", "least"),
    [((236, 178, 42), 0.12), ((58, 66, 80), 0.1), ((28, 32, 40), 0.2), ((128, 128, 128), 0.09)],
    ids=["gold", "line", "dark", "missing"],
)
def test_the_sequential_scale_keeps_clear_of_the_other_colours_of_the_panel(other: colormap.Rgb, least: float) -> None:
    assert distances(colormap.sequential_rgb(SHARES), np.array([other])).min() > least


def test_the_sequential_scale_is_another_than_the_diverging_one() -> None:
    # Only near its pale end may it resemble anything there: the grey of rest.
    nearest = distances(colormap.sequential_rgb(SHARES), colormap.display_rgb(SCALE)).min(axis=1)
    assert nearest.min() > 0.03
    assert nearest[64:].min() > 0.08


def test_a_missing_number_is_no_colour_of_the_sequential_scale() -> None:
    missing, seen = colormap.sequential_rgb([np.nan]), colormap.sequential_rgb(SHARES)
    np.testing.assert_array_equal(missing, colormap.display_rgb([np.nan]))
    assert distances(missing, seen[:1])[0, 0] > 0.25
    assert distances(seen_without_green_cones(missing), seen_without_green_cones(seen)).min() > 0.03


def test_shares_are_clipped() -> None:
    odd = colormap.sequential_rgb([-np.inf, -0.5, 1.5, np.inf])
    low, high = colormap.sequential_rgb([0.0, 1.0])
    np.testing.assert_array_equal(odd, [low, low, high, high])


def texts(svg: str) -> list[str | None]:
    return [element.text for element in ElementTree.fromstring(svg).iter(f"{SVG}text")]


@pytest.mark.parametrize("diverging", [False, True])
def test_the_map_legend_shows_its_table_title_and_ends(diverging: bool) -> None:
    text = colormap.map_legend_svg("weak", "1.2 mm/V", title="authority", diverging=diverging)
    svg = ElementTree.fromstring(text)
    assert sorted(map(str, texts(text))) == sorted(["authority", "weak", "1.2 mm/V", *(["0"] if diverging else [])])
    stops = [element.get("stop-color") for element in svg.iter(f"{SVG}stop")]
    low, high = colormap.display_rgb([-1.0, 1.0]) if diverging else colormap.sequential_rgb([0.0, 1.0])
    assert [stops[0], stops[-1]] == [f"#{bytes(end.tolist()).hex()}" for end in (low, high)]
    assert len(list(svg.iter(f"{SVG}rect"))) == 1  # no swatch that was not asked for


@pytest.mark.parametrize("diverging", [False, True])
def test_the_map_legend_has_a_swatch_for_missing_numbers(diverging: bool) -> None:
    plain = colormap.map_legend_svg("0", "1", title="t", diverging=diverging)
    text = colormap.map_legend_svg("0", "1", title="t", diverging=diverging, missing="not computed")
    svg = ElementTree.fromstring(text)
    swatch = list(svg.iter(f"{SVG}rect"))[-1]
    assert swatch.get("fill") == f"#{bytes(colormap.sequential_rgb([np.nan])[0].tolist()).hex()}"
    assert texts(text) == [*texts(plain), "not computed"]
    bottom = float(swatch.get("y", "nan")) + float(swatch.get("height", "nan"))
    assert bottom < float(svg.get("height", "nan"))


def test_the_map_legend_escapes_what_it_is_given() -> None:
    words = ['<b>&"low', "high</text>", '"><script>', "<none>"]
    text = colormap.map_legend_svg(words[0], words[1], title=words[2], missing=words[3])
    assert sorted(map(str, texts(text))) == sorted(words)
    assert ElementTree.fromstring(text).get("aria-label") == f"{words[2]}: {words[0]} to {words[1]}"
    assert "<script" not in text


def test_legends_that_differ_share_no_gradient() -> None:
    legends = [colormap.legend_svg(1.0, vertical=vertical) for vertical in (False, True)]
    legends += [colormap.map_legend_svg("0", "1", title="t", diverging=diverging) for diverging in (False, True)]
    gradients = [next(ElementTree.fromstring(text).iter(f"{SVG}linearGradient")).get("id") for text in legends]
    assert len(set(gradients)) == len(legends)
    assert all(f"url(#{identity})" in text for identity, text in zip(gradients, legends, strict=True))

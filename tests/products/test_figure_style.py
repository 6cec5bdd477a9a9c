"""Figures in every style: their size, a PDF for papers, labels with units, and parts that a grey copy tells apart."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.figure import Figure
from PIL import Image

from glider_jax.errors import ConfigError
from glider_jax.products import fan, figure_style, planning_figures, reliability
from glider_jax.products.fan import plot_battery
from glider_jax.products.figure_style import STYLES, hatch, save_figure, style_of
from glider_jax.products.maps import plot_map
from glider_jax.products.planning_choice import Sensitivity
from glider_jax.products.planning_figures import plot_tornado
from glider_jax.products.reliability import plot_reliability
from glider_jax.products.summary import summarise
from tests.products.html_pages import surfacings
from tests.products.tracks import gaussian_track, shelf


@pytest.mark.parametrize("style", STYLES)
def test_each_style_has_its_resolution_and_files(tmp_path, style):
    track = gaussian_track(n=80, hours=24.0)
    summary = summarise(track)
    for name, path in (
        ("map", plot_map(track, tmp_path / "map.png", bathymetry=shelf(), summary=summary, style=style)),
        ("battery", plot_battery(track, tmp_path / "battery.png", summary=summary, style=style)),
    ):
        with Image.open(path) as picture:
            assert picture.info["dpi"][0] == pytest.approx(STYLES[style].dpi, abs=0.1), name
            assert picture.width > 9 * STYLES[style].dpi
        pdf = path.with_suffix(".pdf")
        assert pdf.exists() == (style == "paper")
        if style == "paper":
            assert pdf.read_bytes().startswith(b"%PDF")


def test_an_unknown_style_is_named():
    with pytest.raises(ConfigError, match="--style: expected one of screen, print, paper, found 'prnt'.*'print'"):
        style_of("prnt")


def test_papers_have_larger_text_and_no_words_beside_the_axes(tmp_path, monkeypatch):
    seen: dict[str, Figure] = {}

    def keep(figure, path, style="screen", **more):
        seen[style_of(style).name] = figure
        return save_figure(figure, path, style, **more)

    monkeypatch.setattr(fan, "save_figure", keep)
    track = gaussian_track(n=60, hours=24.0)
    for style in STYLES:
        plot_battery(track, tmp_path / f"{style}.png", style=style)
    sizes = {name: figure.axes[0].yaxis.label.get_fontsize() for name, figure in seen.items()}
    assert sizes["paper"] == pytest.approx(1.45 * sizes["screen"]) and sizes["print"] == sizes["screen"]
    assert seen["screen"].texts and not seen["paper"].texts


def labels_of(figure: Figure) -> list[str]:
    """Labels of all axes that hold something, shared ones left out."""
    return [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]


def test_axes_are_labelled_with_units(tmp_path, monkeypatch):
    seen: list[Figure] = []
    for module in (fan, planning_figures, reliability):
        monkeypatch.setattr(module, "save_figure", lambda figure, path, *rest, **more: seen.append(figure) or path)
    plot_battery(gaussian_track(n=60, hours=24.0), tmp_path / "a.png")
    plot_tornado([Sensitivity("$x^2", "+1 sigma", (3.0, 0.2), (-1.0, 0.3))], "km", tmp_path / "b.png", "$name_{")
    plot_reliability(surfacings(), tmp_path / "c.png")
    battery, tornado, cover = (labels_of(figure) for figure in seen)
    assert {"usable charge left (%)", "energy drawn (Wh)", "time (UTC)"} <= set(battery)
    assert "change of energy drawn (Wh)" in tornado
    assert {"promised share", "found share", "error of persistence (km)", "error of the forecast (km)"} == set(cover)


def test_names_from_files_do_not_break_figures(tmp_path):
    # A dollar sign would start a formula and an escape has no glyph; both come from names of recordings.
    assert plot_reliability(surfacings(), tmp_path / "r.png", "paper").exists()
    found = [Sensitivity("a$\\frac{", "x", (1.0, 0.1), (2.0, 0.1))]
    assert plot_tornado(found, "km", tmp_path / "t.png", "cost in $ and \x1b[31m", "print").exists()


def lightness(colour) -> float:
    """CIE lightness of an sRGB colour, 0 to 100."""
    rgb = np.array(colour)
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return 116.0 * np.cbrt(linear @ [0.2126, 0.7152, 0.0722]) - 16.0


def test_a_grey_copy_still_tells_parts_and_densities_apart():
    assert len({hatch(STYLES["print"], k) for k in range(8)}) == 8
    assert hatch(STYLES["screen"], 1) is None
    greys = [lightness(colormaps["viridis"](share)[:3]) for share in np.linspace(0.0, 1.0, 12)]
    assert (np.diff(greys) > 2.0).all(), "more members, another grey"
    assert figure_style.HATCHES[0] == ""

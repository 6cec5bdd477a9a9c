"""Pages in headless Chromium: no error, no request, a slider that moves the map, readable in light and dark."""

from __future__ import annotations

import base64

import pytest

from tests.products.browser import Browser, chromium
from tests.products.html_pages import forecast_page, hindcast_page, plan_page, validation_page
from tests.products.tracks import gaussian_track

KINDS = ("forecast", "plan", "hindcast", "validate")


@pytest.fixture(scope="module")
def browser():
    yield from chromium()


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Paths of a page of every kind."""
    out = tmp_path_factory.mktemp("browser pages #1")
    picture = out / "p.png"
    dot = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
    picture.write_bytes(base64.b64decode(dot))
    return {
        "forecast": forecast_page(out / "forecast.html", n=300),
        "plan": plan_page(out / "plan.html"),
        "hindcast": hindcast_page(out / "hindcast.html"),
        "validate": validation_page(out / "validation.html", picture),
    }


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("width", (1280, 390))
def test_loads_without_errors_or_requests(browser: Browser, pages, kind, width):
    browser.open(pages[kind], width=width, height=900)
    assert browser.said() == []
    assert browser.asked() == []
    assert browser.run("return window.pwned") is None, "no text from files ran"
    loaded = "return performance.getEntriesByType('resource').map(e => e.name).filter(n => !n.startsWith('data:'))"
    assert browser.run(loaded) == []
    # A phone shows the page without moving sideways; tables scroll for themselves.
    assert browser.run("return document.documentElement.scrollWidth") <= width


def test_the_slider_moves_map_words_and_charts(browser: Browser, pages):
    from selenium.webdriver.common.keys import Keys

    browser.open(pages["forecast"])
    state = """const one = (what) => document.querySelector(what);
        return {when: one('#when').textContent, told: one('#told').textContent,
        region: one('path.r90').getAttribute('d'), arrows: one('path.arrow').getAttribute('d'),
        members: one('img.density').src, cursor: one('.cursor').getAttribute('x1'),
        spoken: one('#time').getAttribute('aria-valuetext')}"""
    before = browser.run(state)
    slider = browser.driver.find_element("id", "time")
    slider.send_keys(Keys.ARROW_RIGHT)
    slider.send_keys(Keys.ARROW_RIGHT)
    after = browser.run(state)
    for name in before:
        assert before[name] != after[name], name
    assert after["spoken"] == after["when"]
    browser.run("document.getElementById('back').click()")
    browser.run("document.getElementById('back').click()")
    assert browser.run(state) == before
    slider.send_keys(Keys.HOME)
    assert browser.run("return document.getElementById('when').textContent").endswith("+0 h")
    assert browser.run("return document.querySelectorAll('path.r90').length") == 0, "no region at the start itself"
    assert browser.said() == []


def test_layers_can_be_put_away_and_the_map_moved_by_keys(browser: Browser, pages):
    from selenium.webdriver.common.keys import Keys

    browser.open(pages["forecast"])
    count = "return document.querySelectorAll('path.arrow').length"
    assert browser.run(count) == 1
    browser.run("document.querySelector('[data-layer=arrows]').click()")
    assert browser.run(count) == 0
    place = "return document.querySelector('#map .leaflet-map-pane').style.transform"
    first = browser.run(place)
    board = browser.driver.find_element("id", "map")
    board.send_keys(Keys.ARROW_RIGHT)
    for _ in range(40):
        if browser.run(place) != first:
            break
    assert browser.run(place) != first
    browser.run("document.getElementById('near').click()")
    assert browser.said() == []


def test_rows_of_the_hindcast_show_their_case(browser: Browser, pages):
    browser.open(pages["hindcast"])
    browser.run("document.querySelector('tr[data-frame=\"4\"] td').click()")
    assert browser.run("return document.querySelector('tr.now').dataset.frame") == "4"
    assert " 5: up " in browser.run("return document.getElementById('when').textContent")
    assert browser.run("return document.querySelectorAll('path.r50').length") >= 1


@pytest.mark.parametrize("dark", (False, True))
def test_text_stands_out_in_light_and_dark(browser: Browser, pages, dark):
    browser.open(pages["forecast"], dark=dark)
    assert browser.run("return document.documentElement.dataset.theme") == ("dark" if dark else "light")
    contrast = """
        const pick = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
        const light = (hex) => { const c = [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255)
            .map((v) => (v <= 0.03928 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4)));
            return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
        const ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
            return (x + 0.05) / (y + 0.05); };
        return [['--ink', '--paper'], ['--soft', '--paper'], ['--soft', '--card'], ['--link', '--paper'],
            ['--reserve', '--paper'], ['--ink', '--sea4'], ['--arrow', '--sea8'], ['--outer', '--sea5']]
            .map(([a, b]) => [a, b, ratio(pick(a), pick(b))]);"""
    for front, back, ratio in browser.run(contrast):
        assert ratio >= (3.0 if front in ("--outer", "--arrow") else 4.5), (front, back, ratio)


def test_the_map_lies_across_the_antimeridian(browser: Browser, tmp_path):
    path = forecast_page(tmp_path / "f.html", track=gaussian_track(n=200, longitude=179.9, east=0.4))
    browser.open(path)
    spots = browser.run("""const box = document.getElementById('map').getBoundingClientRect();
        return [...document.querySelectorAll('.pin')].map((p) => { const r = p.getBoundingClientRect();
            return r.left >= box.left - 15 && r.right <= box.right + 15; })""")
    assert len(spots) > 4 and all(spots)
    assert browser.said() == []


def test_the_page_prints(browser: Browser, pages):
    browser.open(pages["forecast"], dark=True)
    printed = browser.driver.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    data = base64.b64decode(printed["data"])
    assert data.startswith(b"%PDF") and len(data) > 20_000
    wide = browser.run("return document.getElementById('map').getBoundingClientRect().width")
    assert wide > 1000, "the map has its size again"
    assert browser.run("return document.documentElement.dataset.theme") == "dark", "the screen is as before"

"""A headless Chromium for tests of pages; tests skip with a reason where it or its driver is not installed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
    "--disable-dev-shm-usage",
)  # fmt: skip


class Browser:
    """A page under test: what it said, what it asked for, and how it looks at a width."""

    def __init__(self, driver) -> None:
        self.driver = driver

    def open(self, path: Path, *, width: int = 1280, height: int = 1000, dark: bool = False) -> None:
        """Load a file at a size and wait until its script says that it is ready."""
        from selenium.webdriver.support.ui import WebDriverWait

        self.driver.get("about:blank")
        self.driver.get_log("browser")
        self.driver.get_log("performance")
        self.resize(width, height)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.driver.get(path.resolve().as_uri())
        WebDriverWait(self.driver, 20).until(
            lambda d: self.run("return document.documentElement.dataset.ready") == "yes"
        )

    def resize(self, width: int, height: int) -> None:
        """Give the window another size."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def run(self, script: str, *words):
        """The value of a piece of script."""
        return self.driver.execute_script(script, *words)

    def said(self) -> list[str]:
        """Messages of the console since the page was opened, warnings and errors."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def asked(self) -> list[str]:
        """Addresses that the page asked for, itself and what lies inside it left out."""
        events = (json.loads(entry["message"])["message"] for entry in self.driver.get_log("performance"))
        sent = [e["params"] for e in events if e["method"] == "Network.requestWillBeSent"]
        page = self.driver.current_url
        urls = [s["request"]["url"] for s in sent if s.get("documentURL", "").startswith("file:")]
        return [url for url in urls if url != page and not url.startswith("data:")]


def chromium() -> Iterator[Browser]:
    """Start a browser of its own profile, and stop it; for a fixture."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium (extra 'browser')")
    from selenium.webdriver.chrome.service import Service

    program = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    guide = shutil.which("chromedriver")
    if not program or not guide:
        pytest.skip("needs chromium and chromedriver (Debian: chromium, chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(guide))
    try:
        yield Browser(driver)
    finally:
        driver.quit()

"""The report in a real browser: the figures are drawn and nothing complains."""

import re
import shutil
import subprocess
from pathlib import Path

import lxml.html
import pytest

from steelyard.identification import Identification
from steelyard.report import write_report

QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--virtual-time-budget=10000",
    "--enable-logging=stderr",
)


@pytest.mark.slow
def test_figures_are_drawn(identification: Identification, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium is installed")
    report = tmp_path / "report.html"
    write_report(identification, report)
    command = [browser, *QUIET, f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", report.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert not re.findall(r".*CONSOLE.*", done.stderr)
    page = lxml.html.fromstring(done.stdout)
    assert page.get("data-figures") == "drawn"
    for joint in range(2):
        plot = page.get_element_by_id(f"torque-{joint}")
        curves = plot.xpath(".//*[contains(@class, 'scatterlayer')]//*[contains(@class, 'js-line')]/@d")
        assert len(curves) == 3
        assert all(len(curve) > 1000 for curve in curves)
        assert "relative error" in plot.get("aria-label")
    assert not page.xpath("//img | //*[contains(@class, 'error')]/*")

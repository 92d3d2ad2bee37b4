"""The report in a real browser: nothing overflows at three widths, pictures load, and it prints."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from fakes.results_folder import results
from fakes.synthetic import field_of, ring_vessel

from granpipe.export.pictures import rz_figures
from granpipe.export.profiles import profile_figures, section_profiles
from granpipe.export.run_report import write_run_report

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
WIDTHS = (1280, 768, 390)

MEASURE = """
<script>
addEventListener("load", () => {
  const found = [...document.querySelectorAll("iframe")].map(frame => {
    const page = frame.contentDocument, root = page.documentElement;
    return {
      width: root.clientWidth, content: root.scrollWidth,
      outside: [...page.querySelectorAll("body *")].filter(one => !one.closest(".scroll table")
        && one.getBoundingClientRect().right > root.clientWidth + 0.5).map(one => one.tagName),
      images: [...page.images].map(one => [one.naturalWidth, one.getBoundingClientRect().width]),
      headings: [...page.querySelectorAll("h1, h2, h3")].map(one => one.tagName),
      ratio: contrast(frame.contentWindow, page),
      requests: frame.contentWindow.performance.getEntriesByType("resource").map(one => one.name)
        .filter(name => !name.startsWith("data:")),
    };
  });
  document.body.textContent = "FOUND" + JSON.stringify(found) + "END";
});
function light(text) {
  const parts = text.match(/[0-9.]+/g).slice(0, 3).map(one => one / 255)
    .map(one => one <= 0.03928 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
  return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
}
function contrast(view, page) {  // the least over the page, as WCAG 2 has it
  let least = 99;
  for (const one of page.querySelectorAll("p, b, dt, dd, a, li, th, td, h1, h2, figcaption")) {
    let behind = one;
    while (behind && view.getComputedStyle(behind).backgroundColor == "rgba(0, 0, 0, 0)") behind = behind.parentElement;
    const [a, b] = [light(view.getComputedStyle(one).color), light(view.getComputedStyle(behind).backgroundColor)];
    least = Math.min(least, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05));
  }
  return least;
}
</script>
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of an analytic flow, with long words in it."""
    vessel, folder = ring_vessel(), tmp_path_factory.mktemp("results")
    quality = [{"name": "a" * 90, "value": 0.4, "limit": "at most " + "b" * 90, "passed": False}]
    results(folder, quality=quality)
    (folder / "figures").mkdir()
    field = field_of(vessel, 0.05)
    rz_figures(field, vessel.wall, vessel.obstacles, folder / "figures", {"throat": (2.0, 0.0)}, "silo")
    profile_figures(section_profiles(field, {"throat": (2.0, 0.0)}), folder / "figures")
    write_run_report(folder)
    return folder / "report.html"


def chromium(folder: Path, *arguments: str | Path) -> str:
    command = [CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    done = subprocess.run([*command, *arguments], capture_output=True, text=True, timeout=120, check=True)
    return done.stdout


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_nothing_overflows_and_everything_is_readable(dark: bool, page: Path, tmp_path: Path) -> None:
    source = page.read_text()
    if dark:
        source = source.replace("(prefers-color-scheme: dark)", "all", 1)
    frames = "".join(
        f'<iframe style="border:0" width="{width}" height="900" srcdoc="{html.escape(source)}"></iframe>'
        for width in WIDTHS
    )
    (tmp_path / "measure.html").write_text(f"<!DOCTYPE html><meta charset=utf-8>{MEASURE}<body>{frames}</body>")
    dom = chromium(tmp_path, "--virtual-time-budget=20000", "--dump-dom", (tmp_path / "measure.html").as_uri())
    match = re.search("<body>FOUND(.*)END</body>", dom)
    assert match, dom[:500]
    found: list[dict[str, Any]] = json.loads(html.unescape(match[1]))
    assert [round(one["width"], -2) for one in found] == [round(width, -2) for width in WIDTHS]
    for one in found:
        assert one["content"] <= one["width"]
        assert one["outside"] == []
        assert len(one["images"]) == 6
        assert all(natural > 100 and shown > 100 for natural, shown in one["images"])
        assert one["headings"] == ["H1"] + ["H2"] * (len(one["headings"]) - 1)
        assert one["requests"] == []
        assert one["ratio"] >= 4.5


def test_it_prints(page: Path, tmp_path: Path) -> None:
    chromium(tmp_path, "--no-pdf-header-footer", f"--print-to-pdf={tmp_path / 'report.pdf'}", page.as_uri())
    pdf = (tmp_path / "report.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 8

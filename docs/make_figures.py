"""Make what pages show: run the commands that stand on them, and put what these print, and their pictures, in place.

    python docs/make_figures.py [PAGE ...] [--small] [--data FOLDER]

PAGE is a file, all of `docs/` and README.md by default. Its blocks of commands are run in their order, in a folder of
the page's own under `build/pages/`. A block without a language that follows one of commands at once becomes what they
print. The reader's `my_filter.py` is examples/own_estimator.py. Remarks before a block or a picture say more:

    <!-- by hand -->              commands that this leaves out: they install, wait for others, or need what is nowhere
    <!-- needs NAME -->           commands that need a file of --data; without it they, and what they printed, stay
    <!-- as NAME -->              a block that is a file of this name before the commands after it are run
    <!-- picture PATH -->         the picture that follows is this file of the page's folder
    <!-- drawn NAME -->           the picture that follows is drawn by this function of docs/drawings.py
    <!-- screenshot PATH[#ID] --> the picture that follows shows this page, or an element of it, in chromium
    <!-- part -->                 a part of what the commands print, which stays
    <!-- fails -->                commands whose exit status 1 is what they are to show

`--small` tries all commands at small sizes and changes nothing. The exit status is 1 if a command fails.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

ROOT = Path(__file__).parents[1]
PIECE = re.compile(
    r"(?:<!-- (?P<mark>by hand|needs|as|picture|drawn|screenshot|part|fails)(?: (?P<name>\S+))? -->\n+)?"
    r"(?:^```(?P<language>[\w{}-]*)\n(?P<block>.*?)^```$|!\[[^]]*\]\((?P<picture>[\w.-]+)\))",
    re.DOTALL | re.MULTILINE,
)
INSTALLED = re.compile(r"^(python3 -m venv .*?&& )?\.venv/bin/(?=slamgauge)", re.MULTILINE)
CHECK = ".venv/bin/pytest"  # the command that is running these
SMALL = (  # sizes of a trial
    (re.compile(r"--runs \d+"), "--runs 2"),
    (re.compile(r"--twins \d+"), "--twins 19"),
    (re.compile(r"--sweep ([\w.]+)=([^, \n]+),[^ \n]*"), r"--sweep \1=\2"),
    (re.compile(r"slamgauge bench"), "slamgauge bench --landmarks 20"),
    (re.compile(r"^python benchmarks/.*$", re.MULTILINE), "true"),  # tests have their smallest sizes
)


def drawn(name: Path) -> Image.Image:
    """Return the figure of a function of docs/drawings.py."""
    plt.style.use("slamgauge.paper")
    file = io.BytesIO()
    runpy.run_path(str(ROOT / "docs/drawings.py"))[name.name]().savefig(file)
    return Image.open(file)


def screenshot(page: Path) -> Image.Image:
    """Return the first screen of a page, or its element of `PATH#ID`; a replay is shown at half its time."""
    path, _, element = str(page).partition("#")
    options = webdriver.ChromeOptions()
    for argument in ("--headless=new", "--no-sandbox", "--hide-scrollbars"):
        options.add_argument(argument)
    with webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver"))) as browser:
        browser.get(Path(path).as_uri())
        browser.set_window_size(1280, 1400 if element else 1000)
        for timeline in browser.find_elements("id", "timeline"):
            timeline.click()
        shown = browser.find_element("id", element).screenshot_as_png if element else browser.get_screenshot_as_png()
    return Image.open(io.BytesIO(shown))


SOURCES = {"picture": Image.open, "drawn": drawn, "screenshot": screenshot}


@dataclass
class Page:
    """A page, and the folder in which its commands are run."""

    path: Path
    small: bool
    data: Path | None

    def make(self) -> list[str]:
        """Run its commands; those that failed."""
        work = ROOT / "build/pages" / self.path.stem
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        for folder in ("examples", "benchmarks"):
            (work / folder).symlink_to(ROOT / folder)
        (work / "my_filter.py").symlink_to(ROOT / "examples/own_estimator.py")
        text = self.path.read_text(encoding="utf-8")
        made, failed = list[str](), list[str]()
        end, printed = 0, None
        for piece in PIECE.finditer(text):
            between, end = text[end : piece.start()], piece.end()
            is_output = printed is not None and piece["language"] == "" and not between.strip() and not piece["mark"]
            made += [between, f"```\n{printed}```" if is_output else piece.group()]
            printed = None
            if piece["mark"] == "as":
                (work / piece["name"]).write_text(piece["block"], encoding="utf-8")
            elif piece["picture"] and piece["mark"] and not self.small:
                # 64 colours: a third of the bytes
                image = SOURCES[piece["mark"]](work / piece["name"]).convert("RGB")
                few = image.quantize(64, Image.Quantize.MAXCOVERAGE, kmeans=8, dither=Image.Dither.NONE)
                few.save(self.path.parent / piece["picture"], optimize=True)
            elif piece["language"] == "sh" and self._is_run(piece, work):
                printed = self._printed(piece["block"], work, {0, 1} if piece["mark"] == "fails" else {0})
                if printed is None:
                    failed.append(piece["block"])
        if not (self.small or failed):
            self.path.write_text("".join(made) + text[end:], encoding="utf-8")
        return failed

    def _is_run(self, piece: re.Match[str], work: Path) -> bool:
        """Whether a block of commands is run; what it needs of `data` is put into the folder."""
        if piece["mark"] != "needs":
            return piece["mark"] != "by hand" and CHECK not in piece["block"]
        there = None if self.data is None else next(self.data.rglob(piece["name"]), None)
        if there is None:
            print(f"{self.path.name}: {piece['name']} is not there; left as it is: {piece['block'].splitlines()[0]}")
            return False
        (work / piece["name"]).unlink(missing_ok=True)
        (work / piece["name"]).symlink_to(there.absolute())
        return True

    def _printed(self, block: str, work: Path, expected: set[int]) -> str | None:
        """What a block of commands prints; None, and its messages are shown, if one fails."""
        block = INSTALLED.sub("", block)
        if self.small:
            for sizes, smaller in SMALL:
                block = sizes.sub(smaller, block)
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "PATH": path, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "80"}
        ran = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block],
            cwd=work,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if ran.returncode not in expected:
            print(f"{self.path.name}: exit status {ran.returncode} of\n{block}{ran.stderr}", file=sys.stderr)
            return None
        return ran.stdout


def main() -> int:
    """Make the pages that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", type=Path, default=[ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))])
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    failed = [block for page in options.pages for block in Page(page.resolve(), options.small, options.data).make()]
    print(f"{len(failed)} blocks of commands failed" if failed else "all commands of these pages ran")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

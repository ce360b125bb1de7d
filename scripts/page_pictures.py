"""Takes the pictures of pages and of the terminal for README and docs from a finished take of the sample capture.

    python scripts/page_pictures.py TAKE docs/images

Needs Chromium and Playwright (`make setup-tests`).
"""

import argparse
import io
import os
import re
import subprocess
import sys
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright
from rich.console import Console
from rich.terminal_theme import DIMMED_MONOKAI
from rich.text import Text

CHROMIUM = "/usr/bin/chromium"
TITLE = "Dance"
PAGES: dict[str, tuple[tuple[int, int], str]] = {
    "player_desktop": ((1080, 675), "?t=1"),
    "player_phone": ((390, 844), ""),
    "player_tablet": ((410, 590), "?t=0.6"),
    "share_desktop": ((1280, 720), "?t=0.4"),
    "share_phone": ((390, 780), "?t=0.4"),
}
"""Size in CSS pixels and query of each picture of the shared page."""
TERMINAL = """<body style="margin: 0"><pre style="margin: 0; padding: 16px; background: #14171c; color: #d8dbe0;
font: 13px/1.35 monospace; width: max-content">{code}</pre>"""


def command(*arguments: str, folder: Path | None = None) -> str:
    """What `v3studio` prints, with escape codes."""
    program = Path(sys.executable).with_name("v3studio")
    environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": "110"}
    done = subprocess.run(
        [program, *arguments], check=True, stdout=subprocess.PIPE, env=environment, cwd=folder, text=True
    )
    return done.stdout


def page_picture(browser: Browser, address: str, name: str, out: Path) -> None:
    """A picture of the shared page, of a still moment or as it opens."""
    (width, height), query = PAGES[name]
    touch = name.endswith("phone")
    context = browser.new_context(viewport={"width": width, "height": height}, has_touch=touch, is_mobile=touch)
    page = context.new_page()
    page.goto(address + query)
    page.wait_for_function("document.querySelector('v3-player')?.state?.ready", timeout=120_000)
    if name == "player_desktop":  # the preview of a moment over the timeline
        page.mouse.move(0.7 * width, height - 53)
    page.wait_for_timeout(3000)
    path = out / f"{name}.jpg"
    page.screenshot(path=path, type="jpeg", quality=85)
    print(path, flush=True)
    context.close()


def terminal_picture(browser: Browser, take: Path, out: Path) -> None:
    """A picture of the status and of the figures of a take."""
    shown = ""
    for name in ("status", "evaluate"):
        shown += f"\033[1m$ v3studio {name} {take.name}\033[0m\n{command(name, take.name, folder=take.parent)}\n"
    shown = re.sub(r"(\033\[(\?25[lh]|\d*[AK]))+\r?\n?", "", shown)  # of progress
    shown = re.sub(r"(\n +4 .*)(\n +\d+\*? .*)+(\n +29 )", r"\1\n     ...\3", shown)  # most frames
    shown = shown.replace(f"{take.parent}/", "")
    screen = Console(record=True, width=110, file=io.StringIO())
    screen.print(Text.from_ansi(shown))
    colored = screen.export_html(theme=DIMMED_MONOKAI, inline_styles=True, code_format=TERMINAL)
    page = browser.new_page(viewport={"width": 980, "height": 400})
    page.set_content(colored)
    page.locator("pre").screenshot(path=out / "terminal.png")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("take", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        site = Path(folder) / "site"
        command(
            "share",
            str(options.take),
            "--out",
            str(site),
            "--title",
            TITLE,
            "--credits",
            "V3 Studio",
            "--license",
            "CC0",
        )
        handler = partial(SimpleHTTPRequestHandler, directory=str(site))
        with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            browser = playwright.chromium.launch(
                executable_path=CHROMIUM, args=["--no-sandbox", "--use-angle=swiftshader"]
            )
            for name in PAGES:
                page_picture(browser, f"http://127.0.0.1:{server.server_port}/", name, options.out)
            terminal_picture(browser, options.take.resolve(), options.out)
            browser.close()
            server.shutdown()


if __name__ == "__main__":
    main()

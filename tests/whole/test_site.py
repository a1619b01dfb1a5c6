"""The site: every page fits a desk's screen and a phone's, without an error, and the search finds pages."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from shared_fixtures.processes.browser import WIDTHS_PX, Browser

ROOT = Path(__file__).parents[2]
FIND = """new Promise(done => {
    const field = document.querySelector('input[data-md-component="search-query"]');
    document.querySelector('#__search').click();
    field.focus();
    field.value = 'event camera';
    field.dispatchEvent(new Event('keyup', {bubbles: true}));
    field.dispatchEvent(new Event('input', {bubbles: true}));
    const look = () => {
        const found = document.querySelectorAll('.md-search-result__item').length;
        found ? done(found) : setTimeout(look, 50);
    };
    look();
})"""


class _Quiet(SimpleHTTPRequestHandler):
    """Serves files without a word."""

    def log_message(self, *_: object) -> None:
        """Write nothing."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """The site as `make docs` builds it, links checked and tutorials run: its address and folder."""
    pytest.importorskip("mkdocs", reason="needs the group `docs`")
    pytest.importorskip("material", reason="needs the group `docs`")
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", folder
    server.shutdown()


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_pages_fit_and_the_search_finds(site: tuple[str, Path], tmp_path: Path) -> None:
    address, folder = site
    pages = sorted(path.parent.relative_to(folder).as_posix() for path in folder.rglob("index.html"))
    assert {"tutorials/slam", "reference/recorder", "findings", "gallery"} <= set(pages)
    with Browser(tmp_path / "profile") as browser:
        for page in pages:
            for width_px in WIDTHS_PX:
                browser.open(f"{address}/{page}/", width_px)
                assert browser.too_wide() == [], (page, width_px)
                broken = "[...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)"
                assert browser.run(broken) == [], page
            assert browser.errors == [], page
        browser.open(f"{address}/", WIDTHS_PX[0])
        assert browser.run(FIND) > 3

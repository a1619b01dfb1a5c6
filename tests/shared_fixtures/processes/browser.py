"""Chromium without a window, driven over its debugging pipe: pages opened at a width, scripts run in them."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
WIDTHS_PX = (1280, 390)
"""A desk's screen and a phone's."""
QUIET = (
    "--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--remote-debugging-pipe",
)  # fmt: skip
FLAT, SOLID = ("--disable-gpu",), ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Pages without WebGL, and with WebGL by Chromium's own software."""
TOO_WIDE = """(() => {
const scrolls = e => e && (/auto|scroll|hidden/.test(getComputedStyle(e).overflowX) && e !== document.body
    || scrolls(e.parentElement));
return [...document.body.querySelectorAll('*')].filter(e => e.getBoundingClientRect().right > %d + 1
    && getComputedStyle(e).position !== 'fixed' && !scrolls(e.parentElement))
    .map(e => e.tagName + ' ' + e.className + ' ' + e.getBoundingClientRect().right);
})()"""
LIMIT_S = 120.0
"""Longest wait for an answer: another process may hold every core."""


class Browser:
    """One page of Chromium; skips the test where there is none.

    Args:
        profile: New folder of the browser.
        drawing: How it draws, `FLAT` or `SOLID`.
    """

    def __init__(self, profile: Path, drawing: tuple[str, ...] = FLAT) -> None:
        if CHROMIUM is None:
            pytest.skip("needs Chromium")
        to_read, self._write = os.pipe()
        self._read, to_write = os.pipe()
        # Chromium reads commands from descriptor 3 and answers on 4, each ended by a zero byte.
        command = f'exec "$0" "$@" 3<&{to_read} 4>&{to_write}'
        flags = [*QUIET, *drawing, f"--user-data-dir={profile}"]
        words = ["bash", "-c", command, CHROMIUM, *flags, "about:blank"]
        self._process = subprocess.Popen(
            words, pass_fds=(to_read, to_write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(to_read)
        os.close(to_write)
        self._buffer, self._count, self._session, self._width_px = b"", 0, "", 0
        self.errors: list[str] = []
        """What pages wrote to the console as errors, failed requests included."""
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._write)
        os.close(self._read)
        self._process.terminate()
        self._process.wait(LIMIT_S)

    def open(self, url: str, width_px: int) -> None:
        """Open a page at a width and wait until it is loaded."""
        self._width_px = width_px
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width_px, height=900, deviceScaleFactor=1, mobile=width_px < 600,
        )  # fmt: skip
        self._call("Page.navigate", url=url)
        self.run("new Promise(done => document.readyState == 'complete' ? done() : onload = done)")

    def run(self, script: str) -> Any:
        """Value of a script in the page, a promise's once it is kept."""
        answer = self._call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def too_wide(self) -> list[str]:
        """Elements that reach beyond the right edge of the screen; parts that scroll are left out."""
        found: list[str] = self.run(TOO_WIDE % self._width_px)
        return found

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            told = self._next()
            if told.get("id") == self._count:
                assert "error" not in told, told
                answer: dict[str, Any] = told["result"]
                return answer
            self._note(told.get("method"), told.get("params", {}))

    def _note(self, event: str | None, about: dict[str, Any]) -> None:
        if event == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(about["exceptionDetails"]))
        elif event == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.errors.append(f"{about['entry']['text']} {about['entry'].get('url', '')}")
        elif event == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.errors.append(json.dumps(about["args"]))

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], LIMIT_S)
            assert ready, "Chromium gives no answer"
            part = os.read(self._read, 1 << 20)
            assert part, "Chromium has ended"
            self._buffer += part
        line, self._buffer = self._buffer.split(b"\0", 1)
        told: dict[str, Any] = json.loads(line)
        return told

"""Compare the installed libraries with the public list of vulnerabilities, where it can be reached.

Exit code 1: a library has a known vulnerability. An index that knows none of the libraries, or does not
answer, is told and passes.
"""

from __future__ import annotations

import json
import subprocess
import sys


def main() -> int:
    """Run pip-audit and judge its answer."""
    command = [
        sys.executable,
        "-m",
        "pip_audit",
        "--format",
        "json",
        "--progress-spinner",
        "off",
        "--timeout",
        "20",
    ]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        libraries = json.loads(ended.stdout)["dependencies"]
    except (subprocess.TimeoutExpired, ValueError, KeyError):
        sys.stdout.write("audit: skipped, the list of vulnerabilities cannot be reached\n")
        return 0
    checked = [library for library in libraries if "skip_reason" not in library]
    if not checked:
        sys.stdout.write("audit: skipped, the index knows no vulnerabilities of these libraries\n")
        return 0
    found = [(library, entry) for library in checked for entry in library["vulns"]]
    for library, entry in found:
        fixed = ", ".join(entry["fix_versions"]) or "no version yet"
        sys.stdout.write(f"audit: {library['name']} {library['version']}: {entry['id']}, mended in {fixed}\n")
    sys.stdout.write(f"audit: {len(checked)} of {len(libraries)} libraries checked, {len(found)} faults\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

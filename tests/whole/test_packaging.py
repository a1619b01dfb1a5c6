"""The wheel holds all that the package needs, and works without the checkout."""

import json
import os
import subprocess
import sys
import venv
import zipfile
from importlib.metadata import distributions
from pathlib import Path

import pytest
from shared_fixtures.processes.checkout import copy_of_checkout, run_pip
from shared_fixtures.processes.notebooks import TUTORIALS, run_notebook

ROOT = Path(__file__).parents[2]
MAPS = [
    f"carlaloc_env/{path.relative_to(ROOT)}"
    for pattern in ("Town*/*.*", "plans/**/*.py")
    for path in (ROOT / "maps").glob(pattern)
]


def test_every_folder_with_code_is_a_package() -> None:
    """A folder without `__init__.py` would be left out of the wheel without a word."""
    for top in ("carlaloc_env", "recorder"):
        for source in (ROOT / top).rglob("*.py"):
            assert (source.parent / "__init__.py").is_file(), source


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from the source distribution of a copy: the checkout stays clean."""
    folder = tmp_path_factory.mktemp("wheel")
    source = copy_of_checkout(folder / "source")
    run_pip("install", "--target", str(folder / "tools"), "setuptools>=77")
    pack = "import sys; from setuptools import build_meta; print(build_meta.build_sdist(sys.argv[1]))"
    made = subprocess.run(
        [sys.executable, "-c", pack, str(folder)],
        cwd=source,
        env=os.environ | {"PYTHONPATH": str(folder / "tools")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    words = ("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder))
    tools = {"PYTHONPATH": str(folder / "tools")}
    done = run_pip(*words, str(folder / made.stdout.split()[-1]), environment=tools)
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("carlaloc-*.whl")
    return built


def test_the_wheel_holds_code_and_data(wheel: Path) -> None:
    """Every module, shader, device profile, marker, map and plan of a town; no tests, no examples."""
    names = set(zipfile.ZipFile(wheel).namelist())
    ours = {
        str(path.relative_to(ROOT))
        for top in ("carlaloc_env", "recorder")
        for path in (ROOT / top).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    kinds = {Path(name).suffix for name in ours}
    assert {".py", ".frag", ".glsl", ".yaml", ".typed"} <= kinds, "the checkout is not what this test expects"
    assert ours | {*MAPS} <= names
    assert "carlaloc_env/maps/Town03/town.xodr" in names
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"carlaloc_env", "recorder"}
    assert wheel.stat().st_size < 60e6


def test_the_wheel_has_the_name_of_its_command(wheel: Path) -> None:
    """So `pip install carlaloc` brings `carlaloc`, and `uvx carlaloc` starts it."""
    (built,) = distributions(path=[str(wheel)])
    (command,) = built.entry_points.select(group="console_scripts")
    assert (built.metadata["Name"], command.name, command.value) == (
        "carlaloc", "carlaloc", "recorder.cli.main:main"
    )  # fmt: skip


def test_an_installed_wheel_finds_its_town(wheel: Path, tmp_path: Path) -> None:
    """Unpacked in an empty folder, away from the checkout, the package lists Town03 and reads its shaders."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    code = (
        "import json, carlaloc_env, recorder\n"
        "from carlaloc_env.map.sources import known_towns\n"
        "from carlaloc_env.map.checks.report import check_map\n"
        "path = known_towns()['Town03']\n"
        "import importlib.resources as r\n"
        "shader = r.files('carlaloc_env').joinpath('render/shaders/shade.frag').read_text()\n"
        "print(json.dumps([carlaloc_env.__file__, recorder.__file__, str(path), len(check_map(path).errors), "
        "len(shader)]))\n"
    )
    environment = {
        key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "CARLALOC_MAPS")
    }
    environment["PYTHONPATH"] = str(tmp_path / "site")
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *places, errors, shader_length = json.loads(done.stdout)
    assert all(place.startswith(str(tmp_path / "site")) for place in places)
    assert errors == 0
    assert shader_length > 500


def test_an_installed_wheel_writes_a_town(wheel: Path, tmp_path: Path) -> None:
    """By the lines of docs/maps.md, away from the checkout; `maps check` finds no error in it."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    page = (ROOT / "docs" / "maps.md").read_text(encoding="utf-8")
    code = page.split("## Writing a town")[1].split("```python\n")[1].split("```")[0]
    script = f"{code}\nimport pathlib\npathlib.Path('village.xodr').write_text(xodr)\n"
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    for words in (["-c", script], ["-m", "recorder.cli.main", "maps", "check", "village.xodr"]):
        command = [sys.executable, *words]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_a_wheel_alone_shows_the_demo(wheel: Path, tmp_path: Path) -> None:
    """In an empty environment, from an empty folder and without a cache; extras are named where they lack."""
    venv.create(tmp_path / "venv", with_pip=True)
    scripts = tmp_path / "venv" / "bin"
    done = run_pip("install", str(wheel), python=str(scripts / "python"))
    assert done.returncode == 0, done.stderr
    (tmp_path / "home").mkdir()

    def carlaloc(*words: str) -> subprocess.CompletedProcess[str]:
        """Run a command as a new user would."""
        environment = {"HOME": str(tmp_path / "home"), "PATH": f"{scripts}:/usr/bin:/bin"}
        command = [str(scripts / "carlaloc"), *words]
        return subprocess.run(
            command, cwd=tmp_path / "home", env=environment, capture_output=True, text=True, check=False
        )

    shown = carlaloc("demo", "--duration", "1", "--json")
    assert shown.returncode == 0, shown.stderr
    result = json.loads(shown.stdout)
    assert list(result["ape_m"]) == ["stereo-vo, ClearNoon", "stereo-vo, RainyNight"]
    assert "carlaloc[slam,report]" in result["missing"]
    assert {path.name for path in (tmp_path / "home" / "carlaloc-demo").iterdir()} == {
        "index.html", "look.jpg", "scene.html", "data", "benchmark"
    }  # fmt: skip
    for words, extra in (
        (("benchmark", "carlaloc-demo/data"), "report"),
        (("odometry", "none.bag", "--out", "e.tum"), "slam"),
        (("view", "carlaloc-demo/data/Town03/ClearNoon_static", "--out", "look.rrd"), "view"),
    ):
        assert f"carlaloc[{extra}]" in carlaloc(*words).stderr, words


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_a_notebook_installs_the_wheel(wheel: Path, tmp_path: Path) -> None:
    """In an environment with a kernel alone, as of a hosted service; the next one finds it installed."""
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv" / "bin" / "python")
    done = run_pip("install", "nbclient", "ipykernel", python=python)
    assert done.returncode == 0, done.stderr
    by_name = {tutorial.stem: tutorial for tutorial in TUTORIALS}
    run_notebook(by_name["slam"], tmp_path, python, CARLALOC_SOURCE=str(wheel))
    first, *_ = run_notebook(by_name["learning"], tmp_path, python, CARLALOC_SOURCE="/nowhere")
    assert first.outputs == []
    code = "import carlaloc_env, importlib.metadata as m; print(m.version('carlaloc'), carlaloc_env.__file__)"
    found = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.split()[1].startswith(str(tmp_path / "venv")), found

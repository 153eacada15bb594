"""What is published: wheel and source distribution have all that is needed, metadata agree."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from email.message import Message
from importlib.metadata import distributions, version
from pathlib import Path

import pytest
import yaml
from packaging.specifiers import SpecifierSet

import seaid

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def tracked(*folders: str) -> list[str]:
    """Return the files that the project has: what git knows of and is there."""
    command = ["git", "ls-files", "--", *folders]
    said = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if said.returncode:
        pytest.skip("no git checkout: which files belong to the project is not known")
    return [name for name in said.stdout.splitlines() if (ROOT / name).is_file()]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[set[str], set[str], Message]:
    """Return the files in wheel and source distribution, and the wheel's metadata.

    Build the project's tracked files elsewhere: the sdist, and the wheel from that alone.
    """
    place, out = tmp_path_factory.mktemp("project"), tmp_path_factory.mktemp("built")
    for name in tracked():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, place / name)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(place)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    (wheel,), (source,) = out.glob("*.whl"), out.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        inside = {*archive.namelist()}
        (name,) = (name for name in inside if name.endswith(".dist-info/METADATA"))
        metadata = message_from_bytes(archive.read(name))
    with tarfile.open(source) as packed:
        names = {one.name.partition("/")[2] for one in packed if one.isfile()}
    return inside, names, metadata


@pytest.mark.slow  # the sdist and the wheel from that
def test_wheel_and_source_distribution_have_every_file_and_nothing_else(
    built: tuple[set[str], set[str], Message],
) -> None:
    """Their metadata are what a package index shows."""
    wheel, source, metadata = built
    package = {name for name in wheel if ".dist-info/" not in name}
    assert package == set(tracked("seaid"))
    assert {"seaid/py.typed", "seaid/report/page/report.css"} <= package
    assert {"LICENSE", "entry_points.txt"} <= {name.rpartition("/")[2] for name in wheel}
    assert set(tracked()) - source <= {".gitignore"}
    assert metadata["Name"] == "seaid"
    assert metadata["License-Expression"] == "BSD-3-Clause"
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert str(metadata.get_payload()).startswith("# seaid")
    assert set(metadata.get_all("Provides-Extra", [])) == set(PROJECT["optional-dependencies"])
    assert metadata["Version"] == seaid.__version__


def test_versions_and_the_citation_are_the_same_everywhere() -> None:
    """In the installation, the citation and the change log; of Python, in the classifiers."""
    assert "version" in PROJECT["dynamic"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.findall(r"^## \[?([\d.]+)", changes, re.MULTILINE)[0]
    assert version("seaid") == CITATION["version"] == newest == seaid.__version__
    assert {"cff-version", "type", "message", "title", "authors", "license"} <= set(CITATION)
    (paper,) = CITATION["references"]
    assert paper["title"].lower() in (ROOT / "README.md").read_text(encoding="utf-8").lower()
    told = {name.rpartition(" ")[2] for name in PROJECT["classifiers"] if "Python :: 3." in name}
    least = PROJECT["requires-python"].removeprefix(">=")
    assert min(told, key=lambda one: int(one.partition(".")[2])) == least
    assert not any(name.startswith("License ::") for name in PROJECT["classifiers"])


def asked_by(requirement: str) -> set[str]:
    """Return the packages that a requirement brings, extras of the project resolved."""
    name, _, extras = re.split(r"[<>=]", requirement)[0].rstrip("]").partition("[")
    if name != "seaid":
        return {name}
    optional = PROJECT["optional-dependencies"]
    return {
        one for extra in extras.split(",") for part in optional[extra] for one in asked_by(part)
    }


def test_every_extra_exists_and_is_part_of_a_pinned_environment() -> None:
    """Those that texts ask for; the environment of the project has all, which resolve together."""
    named: set[str] = set()
    for name in tracked("seaid", "docs", "scripts", "README.md"):
        if name.endswith((".py", ".md", ".j2", ".js")):
            text = (ROOT / name).read_text(encoding="utf-8")
            for extras in re.findall(r"seaid\[([\w,\s-]+)\]", text):
                named |= {extra.strip() for extra in extras.split(",")}
    assert {"parquet", "hdf5", "ros", "hebi"} <= named <= set(PROJECT["optional-dependencies"])
    # some are built from their sources, the others are large: make test-hebi, make test-simulators
    large = {"hebi-py", "drake", "newton", "newton-usd-schemas", "figaroh", "pin-pink", "cmaes"}
    for extra in PROJECT["optional-dependencies"]:
        assert asked_by(f"seaid[{extra}]") <= asked_by("seaid[dev]") | large, extra
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.partition("==")[0] for line in lines if "==" in line}
    for need in ("seaid[dev]", *PROJECT["dependencies"]):
        assert asked_by(need) <= pinned


def test_an_editable_install_is_found_from_the_folder_above_the_checkout(tmp_path: Path) -> None:
    """Python takes a folder without __init__.py for a package if no path has a real one."""
    checkout, site = tmp_path / "seaid", tmp_path / "site"
    (checkout / "seaid").mkdir(parents=True)
    (checkout / "seaid" / "__init__.py").write_text('__version__ = "0.0"\n')
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copyfile(ROOT / name, checkout / name)

    def run(code: str, folder: Path) -> str:
        command = [sys.executable, "-S", "-I", "-c", code]
        return subprocess.run(
            command, cwd=folder, capture_output=True, text=True, check=True
        ).stdout

    paths = [one for one in sys.path if Path(one).name == "site-packages"]
    build = f"import sys; sys.path += {paths}; from setuptools import build_meta; "
    run(f"{build}build_meta.build_editable('.')", checkout)
    with zipfile.ZipFile(next(checkout.glob("*.whl"))) as wheel:
        wheel.extractall(site)
    found = "import sys, site; sys.path.insert(0, ''); site.addsitedir('site'); import seaid; "
    assert run(f"{found}print(seaid.__version__)", tmp_path) == "0.0\n"


def test_the_oldest_python_can_install_what_is_pinned() -> None:
    """For a pin that it cannot install pip searches for hours (soupsieve 4.1.2 on Debian 12)."""
    needed = {x.name: str(x.metadata.json.get("requires_python", "")) for x in distributions()}
    assert {x: y for x, y in needed.items() if not SpecifierSet(y).contains("3.11.0")} == {}

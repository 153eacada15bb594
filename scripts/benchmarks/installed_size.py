"""Size of what an installation of seaid puts on a disk, and of what its tests need besides.

The files are those that pip lists for seaid and for all packages that it needs, in the environment
that runs this script: an extra that is not installed there is an error.

    python scripts/benchmarks/installed_size.py
"""

from __future__ import annotations

from importlib.metadata import distribution
from pathlib import Path

from packaging.requirements import Requirement

Package = tuple[str, tuple[str, ...]]
"""The name of a package, and its extras."""


def with_needs(package: Package, packages: frozenset[Package] = frozenset()) -> frozenset[Package]:
    """Return the packages with one more, and with all that it needs."""
    if package in packages:
        return packages
    packages |= {package}
    name, extras = package
    for text in distribution(name).requires or ():
        need = Requirement(text)
        environments = [{"extra": extra} for extra in extras or ("",)]
        if need.marker is None or any(map(need.marker.evaluate, environments)):
            packages = with_needs((need.name, tuple(sorted(need.extras))), packages)
    return packages


def installed_GB(*extras: str) -> float:
    """Return the size of the files of seaid with some extras, and of all that they need [GB]."""
    names = {name.lower().replace("_", "-") for name, _ in with_needs(("seaid", extras))}
    files = (file.locate() for name in names for file in distribution(name).files or ())
    paths = [Path(str(file)) for file in files]
    return sum(path.stat().st_size for path in paths if path.exists()) / 1e9


if __name__ == "__main__":
    alone, tested = installed_GB(), installed_GB("dev")
    print(f"installed {alone:.1f} GB, for tests {tested - alone:.1f} GB more")

"""Make the measured logs of `models/logs/` from their originals, and check that nothing was lost.

Tables of text (CSV, JSON) become compressed NPZ files with every column and every sample, each
number with the same 64 bits. Binary and small files are copied unchanged. `--check` writes nothing
and compares the shipped files with the originals. `models/logs/README.md` states the origin of the
logs.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

import numpy as np

import seaid
from seaid._arrays import Array
from seaid._files import result_folder
from seaid.log.readers.opening import open_table

ROOT = Path(__file__).resolve().parents[1]
ORIGINALS = ROOT.parent / "shared" / "data"
SHIPPED = ROOT / "models" / "logs"
SETS = {
    "hebi_arms": ("LICENSE.txt", "*.csv"),
    "hebi_x5_unloaded": ("LICENSE.txt",),
    "ur10_exciting": ("LICENSE.txt", "*.csv"),
    "double_pendulum_a0": ("LICENSE.txt", "strong_torque/*.csv", "weak_torque/*.csv"),
    "xl330_pendulum": ("LICENSE.txt", "raw/*.json"),
    "go2_commands": ("LICENSE", "*.csv"),
}
"""The shipped files of each set: its licence, and tables that become NPZ files."""

AS_THEY_ARE = (
    "hebi_x5_unloaded/exampleLog.csv",
    "hebi_x5_unloaded/exampleLog.hebilog",
    "ur10_exciting/ur10_exciting_trajectory.db3",
)
"""Logs that are copied, one per kind of file, so that each reader is tested on a measured log."""


def pairs(originals: Path) -> list[tuple[Path, Path]]:
    """Return the original and the shipped path of every file."""
    found = [Path(name) for name in AS_THEY_ARE]
    for folder, patterns in SETS.items():
        for pattern in patterns:
            found += sorted(
                path.relative_to(originals) for path in (originals / folder).glob(pattern)
            )
    return [(originals / path, SHIPPED / shipped_name(path)) for path in found]


def shipped_name(original: Path) -> Path:
    """Return the name that a file has in the project."""
    if original.name == "LICENSE":
        return original.with_suffix(".txt")
    is_table = original.suffix in (".csv", ".json") and original.as_posix() not in AS_THEY_ARE
    return original.with_suffix(".npz") if is_table else original


def columns(path: Path) -> dict[str, Array]:
    """Return all numeric columns of a log."""
    table = open_table(path)
    found: dict[str, Array] = {}
    for name in table.names:
        try:
            found |= table.load([name])
        except seaid.errors.LogError:
            print(f"excluded: column '{name}' of {path.name}, which has no numbers")
    return found


def ship(original: Path, shipped: Path) -> None:
    """Copy a file, or write its columns as compressed NPZ."""
    result_folder(shipped.parent)
    if original.suffix == shipped.suffix:
        shutil.copyfile(original, shipped)
    else:
        np.savez_compressed(shipped, **columns(original))  # type: ignore[arg-type]


def is_same(original: Path, shipped: Path) -> bool:
    """Return whether a shipped file has exactly the content of its original."""
    if not shipped.is_file():
        return False
    if original.suffix == shipped.suffix:
        return original.read_bytes() == shipped.read_bytes()
    old, new = columns(original), columns(shipped)
    return list(old) == list(new) and all(
        np.array_equal(old[name], new[name], equal_nan=True) for name in old
    )


def main(originals: Path, check: bool) -> None:
    """Ship or check every file, and print the total size."""
    if not originals.is_dir():
        print(f"skipped: the originals are not here, no folder '{originals}'; name it: --originals")
        return
    files = pairs(originals)
    for original, shipped in files:
        if not check:
            ship(original, shipped)
        if not is_same(original, shipped):
            sys.exit(f"error: '{shipped}' does not hold what '{original}' does")
    size = sum(shipped.stat().st_size for _, shipped in files) / 1e6
    print(f"{len(files)} files of {size:.2f} MB in all hold exactly what their originals do")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--originals", type=Path, default=ORIGINALS, help="folder of the originals")
    parser.add_argument("--check", action="store_true", help="compare only, write nothing")
    arguments = parser.parse_args()
    try:
        main(arguments.originals, arguments.check)
    except seaid.SeaidError as error:
        sys.exit(f"error: {error}")

"""Content of the wheel: the four packages, typed, with the shipped missions, and no more."""

import shutil
import zipfile

from tests.e2e.rig import ROOT, python

PACKAGES = ("missions", "vision", "sitl", "uavmap")


def test_wheel_holds_the_four_packages(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name in (*PACKAGES, "packaging"):  # a copy: building must leave no traces in the tree
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, source / name, ignore=ignore)
    for file in ROOT.iterdir():
        if file.is_file():
            shutil.copy(file, source)
    done = python(
        *("-m", "pip", "wheel", "--no-deps", "--no-build-isolation"),
        *("--disable-pip-version-check", "--no-index", "-w", tmp_path, source),
    )
    assert done.code == 0, done.err
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    shipped = {name for name in names if ".dist-info/" not in name}
    there = {
        path.relative_to(source).as_posix()
        for package in PACKAGES
        for path in (source / package).rglob("*")
        if path.is_file()
    }
    assert shipped == there
    assert {f"{package}/py.typed" for package in PACKAGES} <= shipped
    assert {f"missions/shipped/{m}.toml" for m in ("runway", "spill", "road")} <= shipped
    assert any(name.endswith("dist-info/entry_points.txt") for name in names)

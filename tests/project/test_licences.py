"""docs/licences.md names what davis_rs depends on, and deny.toml allows what the crates are under."""

from __future__ import annotations

import re
from importlib.metadata import requires

from places import ROOT

PAGE = (ROOT / "docs" / "licences.md").read_text()
LISTED = {row.group(1): row.group(2) for row in re.finditer(r"^\| (\S.*?) \| (\S.*?) \|$", PAGE, re.MULTILINE)}


def test_every_crate_is_listed_with_its_version() -> None:
    """Of those that Cargo.toml names for the extension module; `.ci/licences` prints the page anew."""
    section = (ROOT / "Cargo.toml").read_text().split("[dependencies]")[1].split("\n[")[0]
    named = set(re.findall(r"^([\w-]+) = ", section, re.MULTILINE))
    locked = re.findall(r'name = "([\w-]+)"\nversion = "([^"]+)"', (ROOT / "Cargo.lock").read_text())
    assert len(named) > 5
    for name, version in locked:
        if name in named:
            assert f"{name} {version}" in LISTED, f"docs/licences.md lacks {name} {version}"


def test_every_package_is_listed() -> None:
    """Of those that users install, with any extra."""
    needed = set[str]()
    for requirement in requires("davis_rs") or []:
        name, extra = re.match(r"[\w.-]+", requirement), re.search(r"extra == ['\"](\w+)", requirement)
        assert name is not None
        if extra is None or extra.group(1) not in {"docs", "interop", "test"}:
            needed.add(name.group().lower())
    assert {"numpy", "torch", "rosbags"} <= needed
    assert needed - {"davis-rs", "davis_rs"} <= LISTED.keys()


def test_licences_of_crates_are_those_that_are_allowed() -> None:
    """Each crate can be had under licences that deny.toml allows, and under nothing else that asks more."""
    allowed = set(re.findall(r'^    "([^"]+)",$', (ROOT / "deny.toml").read_text(), re.MULTILINE))
    crates = {name: licence for name, licence in LISTED.items() if " " in name}
    assert len(crates) > 20
    for name, licence in crates.items():
        for either in re.sub(r"[()]", "", licence).split(" AND "):
            assert allowed & set(either.split(" OR ")), f"{name} is under {licence}"

"""The rules of ARCHITECTURE.md for the Rust crate: who may use whom, no circles, where PyO3 may be."""

from __future__ import annotations

import re
from pathlib import Path

from places import ROOT
from rust_modules import Crate, Module, bare

SOURCE = ROOT / "rust" / "src"
CRATE = Crate(SOURCE)

CIRCLES: list[list[Module]] = [
    # A band takes its pixels near a level through cells of noise all together, and each of them by itself where noise
    # may reach it: one algorithm over one state, which would be a file of 850 lines.
    [("crossing", "effects", "band"), ("crossing", "effects", "near_noise")],
]
"""Groups of files that may use each other in a circle, each with a reason next to it."""


def may_use() -> dict[str, set[str]]:
    """For each module of the crate's root the others that it may use, by the table of ARCHITECTURE.md."""
    text = (ROOT / "ARCHITECTURE.md").read_text()
    table = text[text.index("## Rust") : text.index("## Decisions")]
    allowed: dict[str, set[str]] = {}
    for name, _, may in re.findall(r"^\| (`.*?) \| (.*) \| (.*?) \|$", table, re.MULTILINE):
        names = [module.rstrip("/") for module in re.findall(r"`(.*?)`", name)]
        above = set(allowed)
        for module in names:
            named = {"-": set[str](), "all": above | {"*"}, "all above": above}.get(may)
            allowed[module] = named if named is not None else {used.strip() for used in may.split(",")}
    return allowed


def plant(root: Path, files: dict[str, str]) -> Crate:
    """A crate of these files."""
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return Crate(root)


def test_the_table_names_every_module() -> None:
    """What the table does not name, no rule keeps apart."""
    named, there = set(may_use()), {module[0] for module in CRATE.files if module}
    assert named == there, "the Rust table of ARCHITECTURE.md and rust/src differ"


def test_modules_use_only_what_the_table_allows() -> None:
    """Engine, file formats and camera stream know nothing of each other, and nobody knows the bindings."""
    allowed = may_use()
    wrong = [
        f"{'::'.join(module)} uses {other[0] if other else 'lib.rs'}"
        for module in CRATE.files
        if module and "*" not in allowed[module[0]]
        for other in sorted(CRATE.uses(module))
        if (other[0] if other else "lib.rs") not in allowed[module[0]] | {module[0]}
    ]
    assert wrong == []


def test_the_table_keeps_the_four_apart() -> None:
    """Crossing, aer, write and read meet at the event alone, whatever else the table comes to say."""
    four = {"crossing", "aer", "write", "read"}
    assert all(not may_use()[module] & (four | {"python"}) for module in four)


def test_no_circles() -> None:
    """A file can be read after those that it uses."""
    assert CRATE.circles() == CIRCLES


def test_only_the_bindings_know_pyo3() -> None:
    """So that the crate is one for Rust, too; and unsafe code is in four files."""
    text = {module: bare(path.read_text()) for module, path in CRATE.files.items()}
    assert [module for module in text if "pyo3" in text[module] and module[:1] != ("python",)] == []
    unsafe = {module for module in text if re.search(r"\bunsafe\b", text[module])}
    assert unsafe == {("python", "dtype"), ("prefetch",), ("huge_pages",), ("crossing", "registers", "avx512")}


def test_a_circle_is_found(tmp_path: Path) -> None:
    """Through a re-export, through a path in the code, and over three files; what tests use is none."""
    crate = plant(
        tmp_path,
        {
            "lib.rs": "mod a;\nmod b;\nmod c;\nmod d;\npub use a::{A, Other as Another};\n",
            "a.rs": "use crate::b::{self, B};\npub struct A;\n",
            "b/mod.rs": "mod part;\npub use self::part::B;\n",
            "b/part.rs": "pub struct B;\nfn f() { crate::c::g() }\n",
            "c.rs": 'pub fn g() { let a: crate::A = todo!("}"); }\n',
            "d.rs": "// use crate::d2::X;\n#[cfg(test)]\n#[allow(x)]\nmod tests {\n    use crate::e::E;\n}\n",
            "e.rs": "pub struct E;\nuse super::d;\n",
        },
    )
    assert crate.uses(("d",)) == set()
    assert crate.uses(("e",)) == {("d",)}
    assert crate.circles() == [[("a",), ("b", "part"), ("c",)]]


def test_a_child_that_uses_its_parent_is_a_circle(tmp_path: Path) -> None:
    """If the parent has items of its own and uses the child; an index file that only re-exports is none."""
    child = "use super::helper;\npub struct C;\n"
    files = {"lib.rs": "mod p;\n", "p/child.rs": child}
    parent = "mod child;\nfn helper() { child::C; }\n"
    assert plant(tmp_path / "circle", {**files, "p/mod.rs": parent}).circles() == [[("p",), ("p", "child")]]
    index = "mod child;\nmod help;\npub use child::C;\npub(crate) use help::helper;\n"
    one_way = plant(tmp_path / "index", {**files, "p/mod.rs": index, "p/help.rs": "pub(crate) fn helper() {}\n"})
    assert one_way.circles() == []
    assert one_way.uses(("p", "child")) == {("p", "help")}

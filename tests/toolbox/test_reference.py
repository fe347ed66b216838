"""The pages of the reference that are made from the tools."""

from __future__ import annotations

from toolbox import catalog, reference


def test_each_paper_that_a_tool_is_after_stands_on_its_page() -> None:
    grid = reference.papers("surface.grid").splitlines()
    assert grid[0] == "## References"
    starts = ["- Sibson, R. (1981).", "- Alfeld, P. (1984).", "- Shepard, D. (1968)."]
    assert [line[: len(start)] for line, start in zip(grid[2:], starts, strict=True)] == starts
    csf = reference.papers("ground.csf")
    assert csf.endswith("Remote Sensing 8(6), 501."), "not where we depart from it"
    assert reference.papers("samples.scene") == reference.papers("models.terrain") == ""


def test_no_reference_is_lost() -> None:
    for id, path in catalog.own_files().items():
        named = "\nReferences\n---" in path.read_text("utf-8")
        made = reference.papers(id).splitlines()[2:]
        assert bool(made) == named, id
        assert all(line.startswith("- ") and line.endswith(".") for line in made), id

"""Reads and renders the recipe with the parser of rattler-build, which refuses unknown words.

    uv run --no-project --with py-rattler-build python packaging/conda/check.py

`make release-check` runs it.
"""

from pathlib import Path

from rattler_build import Stage0Recipe, VariantConfig

RECIPE = Path(__file__).with_name("recipe.yaml")

rendered = Stage0Recipe.from_yaml(RECIPE.read_text(encoding="utf-8")).render(VariantConfig())
for variant in rendered:
    package = variant.recipe.package
    needs = len(variant.recipe.requirements.run)
    print(f"{package.name} {package.version}: {needs} requirements, {variant.recipe.about.license}")  # noqa: T201

"""Tests, scenes and benches; a package, or one of that name that is installed would be taken."""

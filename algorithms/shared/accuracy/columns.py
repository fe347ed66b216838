"""Headings and units of the tables of accuracies, as reports show them."""

from __future__ import annotations

from algorithms.shared.accuracy.confusion import CLASS_MEASURES
from toolbox.data.report import Column

_KNOWN = {
    "overall_accuracy": Column("Overall accuracy", "%", 2),
    "producers_accuracy": Column("Producer's accuracy", "%", 2),
    "users_accuracy": Column("User's accuracy", "%", 2),
    "f1": Column("F1", "%", 2),
    "iou": Column("Intersection over union", "%", 2),
    "mean_f1": Column("Mean F1", "%", 2),
    "mean_iou": Column("Mean intersection over union", "%", 2),
    "type_1": Column("Type I error", "%", 2),
    "type_2": Column("Type II error", "%", 2),
    "total_error": Column("Total error", "%", 2),
    "correctness": Column("Correctness", "%", 2),
    "completeness": Column("Completeness", "%", 2),
    "quality": Column("Quality", "%", 2),
    "kappa": Column("Kappa", "", 3),
    "kappa_of_classes": Column("Kappa of all classes", "", 3),
}


def shown(*names: str) -> dict[str, Column]:
    """How the columns of these measures are shown; their limits follow them."""
    return {name: _KNOWN[name] for name in names}


COUNTS = {
    "reference": Column("In the reference"),
    "given": Column("Given"),
    "right": Column("Right"),
}
"""Points of each class."""

OF_CLASSES = shown(*CLASS_MEASURES)
"""Measures of each class."""

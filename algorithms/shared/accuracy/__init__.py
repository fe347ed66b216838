"""Accuracy of classes: confusion matrices, their measures, and how far these can be trusted."""

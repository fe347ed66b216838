"""Power lines from curves: spans, supports and towers, their layers and the labels of points."""

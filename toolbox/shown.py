"""Names of what every run can write beside its own outputs."""

PICTURE = "picture"  # a PNG of all layers
PAGE = "page"  # all results as HTML
COUNTS = "counts"  # a table of how much each step read and gave
DELIVER = "deliver"  # the folder of the set that is handed over; only where one is declared
README = "README.txt"  # in that folder, which names each file
SHOWN = frozenset({PICTURE, PAGE, COUNTS, DELIVER})

"""Figures for a note or a release: ``make bench``, or ``python -m tests.bench NAME ...``.

Times of two programs are taken alternately in one run, and medians and their ratio are printed.
Data comes from the folder named by TOOLBOX_TEST_DATA.
"""

"""Reports of runs: what a tool or model gave, as a document for people."""

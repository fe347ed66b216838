"""The tools as an OGC API - Processes: pygeoapi in front, a queue of processes behind."""

"""Files on the web: addresses that are read like paths, by ranges of bytes that are kept."""

"""The toolbox in QGIS, and algorithms of QGIS in the toolbox."""

"""Features of points"""

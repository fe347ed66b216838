"""Ground"""

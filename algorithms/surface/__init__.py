"""Terrain and surfaces"""

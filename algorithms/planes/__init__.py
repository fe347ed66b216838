"""Planes and façades"""

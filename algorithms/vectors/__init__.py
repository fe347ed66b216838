"""Vectors"""

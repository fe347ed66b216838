"""Accuracy and comparison"""

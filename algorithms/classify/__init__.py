"""Classification"""

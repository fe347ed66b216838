"""Points"""

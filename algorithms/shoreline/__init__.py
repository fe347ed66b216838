"""Water and shorelines"""

"""Power lines"""

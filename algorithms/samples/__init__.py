"""Sample data"""

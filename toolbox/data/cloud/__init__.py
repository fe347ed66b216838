"""What a `PointCloud` does, by subject: plain functions that its methods call.

They see the inside of the class, as they are a part of it; all else uses its methods, which are
documented there.
"""

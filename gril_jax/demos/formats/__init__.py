"""Reads boxes that trackers and annotation tools write beside films, one module a format."""

"""Checks, files, threads and worker processes that every other room may use."""

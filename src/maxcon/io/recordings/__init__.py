"""Recordings of drives: bags, MCAP files and packet captures, read without what recorded them."""

"""From clouds and drives to maps: built, aligned, updated."""

"""The fixed protocol that scores a detector on data sets and tunes its decision."""

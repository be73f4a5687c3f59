"""The file formats of results, with one encoder each."""

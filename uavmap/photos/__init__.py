"""What needs no aircraft: replay of photographs, files of regions, trials of strategies."""

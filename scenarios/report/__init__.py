"""Pages, tables and plots of runs, campaigns and evaluations."""

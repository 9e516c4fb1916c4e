"""The experiments' settings, as the papers print them or as they were chosen here: numbers, and
nothing that runs."""

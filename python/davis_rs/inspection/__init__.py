"""Looking back at datasets: checks, comparisons, summaries, pictures."""

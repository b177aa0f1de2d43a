"""The pages in the browser, joined to the analysis: a replayed flight, a live link, one opened from a notebook."""

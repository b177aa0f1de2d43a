"""Many logs at once on dask.distributed: rows of every flight, in Parquet tables and on one page."""

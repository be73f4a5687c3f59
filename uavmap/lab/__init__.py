"""Trials and studies of strategies, on this machine or on a Dask cluster."""

"""What a person reads: tables in text, and figures (the only importers of matplotlib)."""

"""From files to samples: what columns are, and clocks, gaps, wraps and dropouts mended."""

"""OxTS navigation logs."""

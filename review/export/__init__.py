"""A recording as tables and arrays for other tools, and as a film, as the endoscope sees it or as by X-rays."""

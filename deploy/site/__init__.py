"""The site: documents and API reference as HTML, made by ``python -m deploy.site`` (``./dev docs``)."""

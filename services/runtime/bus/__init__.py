"""The bus: topics, endpoints, keys, clocks of other hosts, and the paths that frames take."""

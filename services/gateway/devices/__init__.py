"""Interfaces of device drivers, and what drivers of several makers share."""

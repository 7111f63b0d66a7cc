"""Haply's Inverse3 and Minverse with a VerseGrip, through the vendor's local service 3.5: JSON on a WebSocket.

The service answers each message with one message, and says nothing else after its first, the inventory.
"""

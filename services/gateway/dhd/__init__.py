"""Arms of Force Dimension (omega, sigma, delta) and Novint's Falcon, through the vendor's C library DHD.

A call of the library may wait for USB. So each device has a thread, which makes one exchange whenever it is asked.
"""

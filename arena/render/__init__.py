"""Films and pictures of recorded flights, drawn without a screen: `arena render RUN`.

`tracks` converts logs to motions at the times of the pictures, `camera` converts points in the room to pixels, `airframe`
contains the faces of a multirotor, `backdrop` and `picture` draw with Pillow, and `film` writes the file. Only `film` and
`sources` read or write files.
"""

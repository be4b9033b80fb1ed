"""From a C3D file to the centre of mass with its band, in three lines.

Reads walk.c3d (the first example writes one). ``stridelab estimate walk.c3d`` does the same. The delay between force
and markers is taken out where it is significant; the third example shows how.
"""

import stridelab as sl

com = sl.estimate_com("walk.c3d", height_m=1.71, mass_kg=60.0, sex="female")
for t, c, sd in zip(com.time_s[::50], com.com_m[::50], 1e3 * com.sd_m[::50], strict=True):
    print(f"{t:5.2f} s   x {c[0]:6.3f}   y {c[1]:6.3f}   z {c[2]:6.3f} m   +- {sd[0]:.0f}, {sd[1]:.0f}, {sd[2]:.0f} mm")

"""Enlarges the images of `synth rooms` to SIDE x SIDE with grain, as JPEG; materials name them. textures-jpeg.py FOLDER SIDE"""
import glob, os, sys
import numpy as np
from PIL import Image
folder, side = sys.argv[1], int(sys.argv[2])
grain = np.random.default_rng(1).normal(0, 6, (side, side, 1)).astype(np.int8).astype(np.int16)
for path in sorted(glob.glob(folder + "/r_*.png")):
    image = Image.open(path).convert("RGB").resize((side, side), Image.BICUBIC)
    image = np.clip(np.asarray(image, dtype=np.int16) + grain, 0, 255).astype(np.uint8)
    Image.fromarray(image).save(path[:-3] + "jpg", quality=88)
    os.remove(path)
mtl = open(folder + "/r.mtl").read()
open(folder + "/r.mtl", "w").write(mtl.replace(".png", ".jpg"))

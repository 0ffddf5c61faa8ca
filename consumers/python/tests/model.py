"""Prints what is in a model file: model.py MODEL"""

import sys

import natural_kinds

model = natural_kinds.load_model(sys.argv[1])
print(f"id {model.id}")
for name, array in model.items():
    print(f"{name} {array.dtype} {list(array.shape)}")
for name in ["weights", "squared_radii"]:
    print(model[name].tolist())

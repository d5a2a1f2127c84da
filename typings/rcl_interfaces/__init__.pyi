# Written by typings/make.py.

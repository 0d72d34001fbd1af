"""A person looks at a plan: the review sheet, and the digest by which what was seen is accepted.

sheet_input  everything that a sheet shows, as one plain record
sheet        the record as a picture
views        a bundle without a slice, from three sides
labels       where the captions on the slice go
paper        pages, letters, and what stands where
digest       64 hexadecimal digits over what a sheet shows
acceptance   answers, a name and the digest, stored in a bundle
"""

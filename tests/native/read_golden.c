/* Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
 *
 * Reads a bundle with nothing but libhdf5: for every dataset a line "path bytes sum", with the sum
 * of its raw bytes, and for every attribute of the root a line "@name value". */
#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>

static int failures = 0;

static void dataset(hid_t object, const char* path) {
    hid_t type = H5Dget_type(object), space = H5Dget_space(object);
    size_t bytes = H5Tget_size(type) * (size_t)H5Sget_simple_extent_npoints(space);
    unsigned char* data = malloc(bytes);
    unsigned long sum = 0;
    if (H5Dread(object, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0) ++failures;
    for (size_t i = 0; i < bytes; ++i) sum += data[i];
    printf("/%s %zu %lu\n", path, bytes, sum);
    free(data);
    H5Sclose(space);
    H5Tclose(type);
}

static herr_t visit(hid_t root, const char* path, const H5O_info_t* info, void* unused) {
    (void)unused;
    if (info->type == H5O_TYPE_DATASET) {
        hid_t object = H5Dopen2(root, path, H5P_DEFAULT);
        dataset(object, path);
        H5Dclose(object);
    }
    return 0;
}

static herr_t attribute(hid_t root, const char* name, const H5A_info_t* info, void* unused) {
    hid_t object = H5Aopen(root, name, H5P_DEFAULT), type = H5Aget_type(object);
    char* text = calloc(H5Tget_size(type) + 1, 1);
    (void)info, (void)unused;
    if (H5Aread(object, type, text) < 0) ++failures;
    printf("@%s %s\n", name, text);
    free(text);
    H5Tclose(type);
    H5Aclose(object);
    return 0;
}

int main(int argc, char** argv) {
    hid_t file = argc == 2 ? H5Fopen(argv[1], H5F_ACC_RDONLY, H5P_DEFAULT) : -1;
    if (file < 0) return 1;
    if (H5Aiterate2(file, H5_INDEX_NAME, H5_ITER_INC, NULL, attribute, NULL) < 0) ++failures;
    if (H5Ovisit(file, H5_INDEX_NAME, H5_ITER_INC, visit, NULL) < 0) ++failures;
    H5Fclose(file);
    return failures != 0;
}

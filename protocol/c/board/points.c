/* The array, and the drive of focal points.  SPEC.md HG-5.4 and HG-7.5. */

#include "points.h"

#include <math.h>

#define TURN 6.283185307179586476925

/* Element n = ix * ny + iy, centred, micrometres. */
static void position(const struct board *board, size_t n, double *x_um, double *y_um)
{
    const struct array *array = &board->array;

    *x_um = ((double)(n / array->ny) - (array->nx - 1) / 2.0) * array->pitch_um;
    *y_um = ((double)(n % array->ny) - (array->ny - 1) / 2.0) * array->pitch_um;
}

void points_element(const struct board *board, size_t number, uint8_t *to)
{
    struct hg_element element;
    double x_um, y_um;

    position(board, number, &x_um, &y_um);
    memset(&element, 0, sizeof element);
    element.x_um = (int32_t)floor(x_um + 0.5);
    element.y_um = (int32_t)floor(y_um + 0.5);
    element.nz = 32767;
    hg_element_write(to, &element);
}

static void quantise(double real, double imaginary, uint8_t *phase, uint8_t *amplitude)
{
    double magnitude = sqrt(real * real + imaginary * imaginary);
    double turns = magnitude > 0 ? atan2(imaginary, real) / TURN : 0;

    *phase = (uint8_t)((int)floor(turns * 256 + 0.5) & 0xFF);
    *amplitude = (uint8_t)floor(255 * (magnitude < 1 ? magnitude : 1) + 0.5);
}

void points_drive(const struct board *board, const uint8_t *points, size_t count,
                  struct drive *drive)
{
    double per_um = BOARD_CARRIER_HZ / (board->config.sound_speed_mm_s * 1e3); /* turns */
    struct hg_focal_point focus[BOARD_MAX_POINTS];
    size_t n, i;

    for (i = 0; i < count; i++)
        hg_focal_point_read(&focus[i], points + i * HG_SIZE_FOCAL_POINT);
    for (n = 0; n < board->count; n++) {
        double real = 0, imaginary = 0, x_um, y_um;

        position(board, n, &x_um, &y_um);
        for (i = 0; i < count; i++) {
            double x = focus[i].x_um - x_um, y = focus[i].y_um - y_um, z = focus[i].z_um;
            double turns = focus[i].phase / 65536.0 - sqrt(x * x + y * y + z * z) * per_um;

            real += focus[i].amplitude / 65535.0 * cos(TURN * turns);
            imaginary += focus[i].amplitude / 65535.0 * sin(TURN * turns);
        }
        quantise(real, imaginary, &drive->phase[n], &drive->amplitude[n]);
    }
}

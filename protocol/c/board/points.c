/* The array, and the drive of focal points.  SPEC.md HG-5.4 and HG-7.5.

   What a point has in common for all elements, its distance from the centre in turns, is computed in
   double precision, once: it may be a million turns.  What differs between the elements is computed
   in single precision, from differences that are no longer than the array. */

#include "points.h"

#include <math.h>

struct place {
    float x_um, y_um;
};

/* A focal point, as each element needs it. */
struct focus {
    float x_um, y_um, z_um;
    float distance_um; /* from the centre */
    float phase_turns; /* of the whole turns nothing is left */
    float amplitude;   /* 1: full */
};

/* Twice the place of element n = ix * ny + iy along x and y, in pitches, from the centre. */
static int32_t twice_ix(const struct array *array, size_t n)
{
    return 2 * (int32_t)(n / array->ny) - (array->nx - 1);
}

static int32_t twice_iy(const struct array *array, size_t n)
{
    return 2 * (int32_t)(n % array->ny) - (array->ny - 1);
}

/* Half of a number, rounded up. */
static int32_t half(int64_t twice)
{
    return (int32_t)((twice + 1 - (twice + 1 < 0 && (twice + 1) % 2 != 0)) / 2);
}

void points_element(const struct board *board, size_t number, uint8_t *to)
{
    int64_t pitch_um = board->array.pitch_um;
    struct hg_element element;

    memset(&element, 0, sizeof element);
    element.x_um = half(twice_ix(&board->array, number) * pitch_um);
    element.y_um = half(twice_iy(&board->array, number) * pitch_um);
    element.nz = 32767;
    hg_element_write(to, &element);
}

/* --- Sine, cosine and angle in turns: polynomials, no library ---------------------------------- */

#define TERMS(series) (sizeof(series) / sizeof(series)[0])

/* Return x p(x^2). */
static float odd(const float *series, size_t terms, float x)
{
    float square = x * x, sum = 0;

    while (terms-- > 0)
        sum = sum * square + series[terms];
    return sum * x;
}

/* Return the turns that are left of any number of them, -1/2 to 1/2. */
static float fraction(float turns)
{
    return turns - (float)(int32_t)(turns < 0 ? turns - 0.5f : turns + 0.5f);
}

/* Error below 2e-7. */
static float sine(float turns)
{
    static const float series[] = {6.283185005f, -41.34165573f, 81.60100555f, -76.54975891f,
                                   39.53654861f};
    float x = fraction(turns);

    if (x > 0.25f)
        x = 0.5f - x;
    else if (x < -0.25f)
        x = -0.5f - x;
    return odd(series, TERMS(series), x);
}

/* Error below 1e-7 of a turn. */
static float angle(float real, float imaginary)
{
    static const float series[] = {0.1591543257f,  -0.05302622169f, 0.03152500466f, -0.02106118761f,
                                   0.01267200615f, -0.005347911734f, 0.001084024785f};
    float x = real < 0 ? -real : real, y = imaginary < 0 ? -imaginary : imaginary;
    float turns = 0;

    if (y > x)
        turns = 0.25f - odd(series, TERMS(series), x / y);
    else if (x > 0)
        turns = odd(series, TERMS(series), y / x);
    turns = real < 0 ? 0.5f - turns : turns;
    return imaginary < 0 ? -turns : turns;
}

/* --- Drive ------------------------------------------------------------------------------------ */

static void read_focus(const struct board *board, const uint8_t *point, struct focus *focus)
{
    struct hg_focal_point wire;
    double x_um, y_um, z_um, distance_um, turns;

    hg_focal_point_read(&wire, point);
    x_um = wire.x_um, y_um = wire.y_um, z_um = wire.z_um;
    distance_um = sqrt(x_um * x_um + y_um * y_um + z_um * z_um);
    turns = wire.phase / 65536.0
            - distance_um * (BOARD_CARRIER_HZ / (board->config.sound_speed_mm_s * 1e3));
    focus->x_um = (float)x_um;
    focus->y_um = (float)y_um;
    focus->z_um = (float)z_um;
    focus->distance_um = (float)distance_um;
    focus->phase_turns = (float)(turns - floor(turns));
    focus->amplitude = wire.amplitude / 65535.0f;
}

/* Return how much farther the point is from this place than from the centre. */
static float farther_um(const struct focus *focus, const struct place *place)
{
    float x_um = focus->x_um - place->x_um, y_um = focus->y_um - place->y_um;
    float away_um = sqrtf(x_um * x_um + y_um * y_um + focus->z_um * focus->z_um);
    float both_um = away_um + focus->distance_um;

    /* a - b = (a^2 - b^2) / (a + b), where a and b may be far longer than a - b */
    if (both_um <= 0)
        return 0;
    return (place->x_um * (place->x_um - 2 * focus->x_um)
            + place->y_um * (place->y_um - 2 * focus->y_um))
           / both_um;
}

static uint8_t phase_code(float turns)
{
    float steps = turns * 256 + 0.5f;
    int32_t whole = (int32_t)steps;

    return (uint8_t)((uint32_t)(whole - (steps < (float)whole)) & 0xFFu); /* rounded down */
}

static uint8_t amplitude_code(float amplitude)
{
    return (uint8_t)(255 * (amplitude < 1 ? amplitude : 1) + 0.5f);
}

/* The sum of the points; a single one needs neither sine nor angle. */
static void superpose(const struct focus *focus, size_t count, const float *turns, uint8_t *phase,
                      uint8_t *amplitude)
{
    float real = 0, imaginary = 0;
    size_t i;

    if (count == 1) {
        *phase = focus->amplitude > 0 ? phase_code(*turns) : 0;
        *amplitude = amplitude_code(focus->amplitude);
        return;
    }
    for (i = 0; i < count; i++) {
        real += focus[i].amplitude * sine(turns[i] + 0.25f);
        imaginary += focus[i].amplitude * sine(turns[i]);
    }
    *phase = phase_code(angle(real, imaginary));
    *amplitude = amplitude_code(sqrtf(real * real + imaginary * imaginary));
}

void points_drive(const struct board *board, const uint8_t *points, size_t count,
                  struct drive *drive)
{
    float per_um = (float)BOARD_CARRIER_HZ / ((float)board->config.sound_speed_mm_s * 1e3f);
    float half_pitch_um = (float)board->array.pitch_um / 2;
    struct focus focus[BOARD_MAX_POINTS];
    float turns[BOARD_MAX_POINTS];
    size_t n, i;

    for (i = 0; i < count; i++)
        read_focus(board, points + i * HG_SIZE_FOCAL_POINT, &focus[i]);
    for (n = 0; n < board->count; n++) {
        struct place place;

        place.x_um = (float)twice_ix(&board->array, n) * half_pitch_um;
        place.y_um = (float)twice_iy(&board->array, n) * half_pitch_um;
        for (i = 0; i < count; i++)
            turns[i] = fraction(focus[i].phase_turns - farther_um(&focus[i], &place) * per_um);
        superpose(focus, count, turns, &drive->phase[n], &drive->amplitude[n]);
    }
}

/* Minigrid's FourRooms for many worlds in a plain C loop: what `benchmarks.grid_loop` holds the batch against.
 *
 * The same draws (NumPy's PCG64 and bounded integers), layouts, views, rewards, ends and resets at the step after an end.
 */
#include <stdint.h>
#include <string.h>

enum { SIZE = 19, VIEW = 7, LIMIT = 100, EMPTY = 1, WALL = 2, GOAL = 8 };

typedef struct {
  uint64_t high, low, increment_high, increment_low, has_half, half;
} Rng;

typedef struct {
  Rng rng;
  int32_t x, y, direction, step, over;
  uint8_t cells[SIZE * SIZE];
} World;

static uint64_t next64(Rng *rng) {
  const __uint128_t by = (__uint128_t)0x2360ED051FC65DA4u << 64 | 0x4385DF649FCCF645u;
  __uint128_t state = (__uint128_t)rng->high << 64 | rng->low;
  state = state * by + ((__uint128_t)rng->increment_high << 64 | rng->increment_low);
  rng->high = state >> 64;
  rng->low = state;
  const uint64_t mixed = rng->high ^ rng->low;
  const unsigned turn = rng->high >> 58;
  return mixed >> turn | mixed << (-turn & 63);
}

static uint32_t next32(Rng *rng) {
  if (rng->has_half) {
    rng->has_half = 0;
    return rng->half;
  }
  const uint64_t whole = next64(rng);
  rng->has_half = 1;
  rng->half = whole >> 32;
  return whole;
}

static int integer(Rng *rng, int low, int high) {
  const uint64_t span = high - low;
  for (;;) {
    const uint64_t scaled = next32(rng) * span;
    const uint32_t left = scaled;
    if (left >= span || left >= (uint32_t)(-span) % span) return low + (int)(scaled >> 32);
  }
}

static void draw_place(World *world, int *x, int *y) {
  do {
    *x = integer(&world->rng, 0, SIZE);
    *y = integer(&world->rng, 0, SIZE);
  } while (world->cells[*x * SIZE + *y] != EMPTY || (*x == world->x && *y == world->y));
}

static void lay_out(World *world) {
  uint8_t *cells = world->cells;
  const int half = SIZE / 2;
  memset(cells, EMPTY, SIZE * SIZE);
  for (int k = 0; k < SIZE; k++) cells[k] = cells[(SIZE - 1) * SIZE + k] = cells[k * SIZE] = cells[k * SIZE + SIZE - 1] = WALL;
  for (int j = 0; j < 2; j++) {
    for (int i = 0; i < 2; i++) {
      const int left = i * half, top = j * half, right = left + half, bottom = top + half;
      if (i == 0) {
        for (int k = 0; k < half; k++) cells[right * SIZE + top + k] = WALL;
        cells[right * SIZE + integer(&world->rng, top + 1, bottom)] = EMPTY;
      }
      if (j == 0) {
        for (int k = 0; k < half; k++) cells[(left + k) * SIZE + bottom] = WALL;
        cells[integer(&world->rng, left + 1, right) * SIZE + bottom] = EMPTY;
      }
    }
  }
  int x, y;
  world->x = world->y = -1;
  draw_place(world, &x, &y);
  world->x = x;
  world->y = y;
  world->direction = integer(&world->rng, 0, 4);
  draw_place(world, &x, &y);
  cells[x * SIZE + y] = GOAL;
  world->step = world->over = 0;
}

static const uint8_t SHOWN[9][3] = {[EMPTY] = {1, 0, 0}, [WALL] = {2, 5, 0}, [GOAL] = {8, 1, 0}};

/* image[right][down][3]; the agent is at the bottom's middle and looks up */
static void see(const World *world, uint8_t *image) {
  static const int ahead_x[4] = {1, 0, -1, 0}, ahead_y[4] = {0, 1, 0, -1};
  const int dx = ahead_x[world->direction], dy = ahead_y[world->direction];
  unsigned ahead = 1 << VIEW / 2;
  for (int distance = 0; distance < VIEW; distance++) {
    uint8_t codes[VIEW];
    unsigned clear = 0;
    for (int i = 0; i < VIEW; i++) {
      const unsigned x = world->x + distance * dx - (i - VIEW / 2) * dy, y = world->y + distance * dy + (i - VIEW / 2) * dx;
      codes[i] = x < SIZE && y < SIZE ? world->cells[x * SIZE + y] : WALL;
      clear |= (unsigned)(codes[i] != WALL) << i;
    }
    unsigned giving = ahead & clear;
    giving = ((giving + clear ^ clear) | giving) & clear & 63;
    unsigned seen = ahead | giving << 1;
    ahead = giving | giving << 1;
    giving = seen & clear;
    for (int k = 0; k < VIEW - 1; k++) giving |= giving >> 1 & clear;
    giving &= 126;
    seen |= giving >> 1;
    ahead |= giving | giving >> 1;
    for (int i = 0; i < VIEW; i++) {
      const uint8_t *shown = SHOWN[seen >> i & 1 ? codes[i] : 0];
      uint8_t *cell = image + 3 * (i * VIEW + VIEW - 1 - distance);
      cell[0] = shown[0];
      cell[1] = shown[1];
      cell[2] = shown[2];
    }
  }
  memcpy(image + 3 * (VIEW / 2 * VIEW + VIEW - 1), SHOWN[EMPTY], 3); /* nothing is carried */
}

int64_t world_bytes(void) { return sizeof(World); }

void reset(World *worlds, int64_t count, const uint64_t *rng_states, uint8_t *images, int64_t *directions) {
  for (int64_t n = 0; n < count; n++) {
    memcpy(&worlds[n].rng, rng_states + 6 * n, sizeof(Rng));
    lay_out(&worlds[n]);
    see(&worlds[n], images + 3 * VIEW * VIEW * n);
    directions[n] = worlds[n].direction;
  }
}

void step(World *worlds, int64_t count, const int64_t *actions, uint8_t *images, int64_t *directions, double *rewards,
          uint8_t *terminated, uint8_t *truncated) {
  static const int ahead_x[4] = {1, 0, -1, 0}, ahead_y[4] = {0, 1, 0, -1};
  for (int64_t n = 0; n < count; n++) {
    World *world = &worlds[n];
    rewards[n] = 0.0;
    terminated[n] = truncated[n] = 0;
    if (world->over) {
      lay_out(world);
    } else {
      world->step++;
      if (actions[n] < 2) {
        world->direction = (world->direction + (actions[n] ? 1 : 3)) % 4;
      } else if (actions[n] == 2) {
        const int x = world->x + ahead_x[world->direction], y = world->y + ahead_y[world->direction];
        const uint8_t code = world->cells[x * SIZE + y];
        if (code != WALL) {
          world->x = x;
          world->y = y;
        }
        if (code == GOAL) {
          terminated[n] = 1;
          rewards[n] = 1 - 0.9 * (world->step / (double)LIMIT);
        }
      }
      truncated[n] = world->step >= LIMIT;
      world->over = terminated[n] | truncated[n];
    }
    see(world, images + 3 * VIEW * VIEW * n);
    directions[n] = world->direction;
  }
}

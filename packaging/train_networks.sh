#!/bin/sh
# Every network that comes with tsbench, one after the other: train_networks.sh OUT SEED SIZE DEVICE (`make train`).
# `plant2-ft` and `plant2-blind` begin with the `plant2` trained before them.
set -eu
out=$1 seed=$2 size=$3 device=$4
on="--seed $seed --device $device"
lessons="--planner idm-e --rate 3e-4 --validation 4 $on --workers 1"
# What two rounds of `plant2-ft` had learned least of, by kept-out maps of the train split.
hard=crosswalk,yield,roundabout,bus_lane,detour_either,direction_left,direction_straight,direction_straight_left,no_turn_right
harder=detour_either,main_road,secondary_road,yield,stop,crosswalk,bus_lane,bike_lane_road,bus_lane_road,direction_left,direction_left_right,no_turn_left,no_turn_right
detours=detour_either,detour_left,detour_right

tsbench train plant2 --size "$size" --drives 2400 --epochs 5 --validation 48 $on --workers 1 --out "$out/plant2"

round() {  # BASE OUT OPTIONS…: a round of lessons
    base=$1 made=$2
    shift 2
    tsbench train plant2-ft --base "$out/$base" $lessons "$@" --out "$out/$made"
}
student() {  # NAME TAKEOVER OUT OPTIONS…: a round in which the network of the last one drives a part
    last=$1 takeover=$2 next=$3
    shift 3
    round "$last" "$next" --student "$out/$last" --takeover "$takeover" "$@"
}
round plant2 plant2-ft-1 --drives 3480 --epochs 6
student plant2-ft-1 0.3 plant2-ft-2 --drives 1200 --more priority,obstacles --epochs 4 --rate 1.5e-4
student plant2-ft-2 0.35 plant2-ft-3 --drives 4700 --more $hard --epochs 3 --perception production --perceived 0.3 --rate 2e-4
student plant2-ft-3 0.35 plant2-ft --drives 2200 --more $harder --epochs 3 --perception production --perceived 0.3 --rate 1.5e-4
round plant2 plant2-blind --mask-signs --drives 1160 --epochs 8

tsbench train ppo --steps 120000 --rate 1e-4 --imitation 40 --workers 6 --seed "$seed" --more $detours \
    --types priority,speed,routing,bus_lane,bike_lane,$detours --out "$out/ppo"
tsbench train carl --steps 410000 --rate 1.5e-4 --imitation 120 --workers 6 --more priority,detour_left --seed "$seed" \
    --out "$out/carl"
